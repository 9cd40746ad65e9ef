//! `fleetfoot show`.

use fleetfoot::{Error, describe, describe_transitions};

use super::{Context, read_model, write_out};
use crate::args::Show;

pub(crate) fn show(arguments: &Show, context: &Context) -> Result<(), Error> {
    let model = read_model(&arguments.model)?;
    if context.json {
        write_out(&model.to_json());
    } else if arguments.transitions {
        let missing = || {
            Error::missing(format!(
                "{}: no transitions were counted for this model; those of `fit pwa --partition refined:K`, `lattice:K` and `tree:DEPTH` carry them",
                arguments.model.display()
            ))
        };
        write_out(&describe_transitions(&model).ok_or_else(missing)?);
    } else {
        write_out(&describe(&model, arguments.regions));
    }
    Ok(())
}
