//! `fleetfoot show`.

use fleetfoot::{ControllerFile, Error, describe, describe_transitions, made_controller};

use super::{Context, control, read_model, write_out};
use crate::args::Show;

pub(crate) fn show(arguments: &Show, context: &Context) -> Result<(), Error> {
    if let Some(made) = made_controller(&arguments.model)? {
        return controller(&made, arguments, context);
    }
    let model = read_model(&arguments.model)?;
    if context.json {
        write_out(&model.to_json());
    } else if arguments.transitions {
        let missing = || {
            Error::missing(format!(
                "{}: this model has no counted transitions; fit it by `fit pwa --partition refined:K`, `lattice:K` or `tree:DEPTH`, or with any partition and --phase",
                arguments.model.display()
            ))
        };
        write_out(&describe_transitions(&model, arguments.all_pairs).ok_or_else(missing)?);
    } else {
        write_out(&describe(&model, arguments.regions));
    }
    Ok(())
}

/// Prints a controller written by `control lqr`.
fn controller(made: &ControllerFile, arguments: &Show, context: &Context) -> Result<(), Error> {
    if arguments.transitions {
        return Err(Error::missing(format!(
            "{}: a controller has no transitions; show those of the model that it was made for",
            arguments.model.display()
        )));
    }
    context.notes(&made.notes);
    context.print(made.to_value(), || control::describe(made, arguments.regions));
    Ok(())
}
