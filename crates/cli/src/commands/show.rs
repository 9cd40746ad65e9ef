//! `fleetfoot show`.

use fleetfoot::{Error, describe};

use super::{Context, read_model, write_out};
use crate::args::Show;

pub(crate) fn show(arguments: &Show, context: &Context) -> Result<(), Error> {
    let model = read_model(&arguments.model)?;
    if context.json {
        write_out(&model.to_json());
    } else {
        write_out(&describe(&model, arguments.regions));
    }
    Ok(())
}
