//! `fleetfoot show`.

use fleetfoot::{Error, describe};

use super::{Context, read_model};
use crate::args::Show;

pub(crate) fn show(arguments: &Show, context: &Context) -> Result<(), Error> {
    let model = read_model(&arguments.model)?;
    if context.json {
        print!("{}", model.to_json());
    } else {
        print!("{}", describe(&model, arguments.regions));
    }
    Ok(())
}
