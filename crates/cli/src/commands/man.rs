//! `fleetfoot man`: manual pages, made from the arguments.

use clap::CommandFactory;
use fleetfoot::{
    Error,
    output::{together, write_atomic},
};

use super::{Context, Files};
use crate::{
    args::{Cli, Man},
    help,
};

pub(crate) fn man(arguments: &Man, context: &Context) -> Result<(), Error> {
    let mut command = help::grouped(Cli::command()).disable_help_subcommand(true);
    command.build();
    let pages = pages(&command);
    let folder = &arguments.output;
    let refused = |problem: std::io::Error| Error::output(format!("{} cannot be made: {problem}", folder.display()));
    std::fs::create_dir_all(folder).map_err(refused)?;
    together(|| pages.iter().try_for_each(|(name, page)| write_atomic(folder.join(name), page)))?;
    let files: Vec<String> = pages.iter().map(|(name, _)| folder.join(name).display().to_string()).collect();
    context.print(Files { files: &files }, || format!("wrote {}", files.join(", ")));
    Ok(())
}

/// The page of a command and those of all commands below it, by file name.
fn pages(command: &clap::Command) -> Vec<(String, Vec<u8>)> {
    let page = clap_mangen::Man::new(command.clone());
    let mut text = Vec::new();
    // Writing to memory does not fail.
    let _ = page.render(&mut text);
    let file_page = (page.get_filename(), text);
    let below = command.get_subcommands().filter(|below| !below.is_hide_set()).flat_map(pages);
    std::iter::once(file_page).chain(below).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page() {
        let mut command = help::grouped(Cli::command()).disable_help_subcommand(true);
        command.build();
        let pages = pages(&command);
        let of = |name: &str| {
            let page = pages.iter().find(|(file, _)| file == name).unwrap_or_else(|| panic!("no {name}"));
            String::from_utf8_lossy(&page.1).into_owned()
        };
        assert!(of("fleetfoot.1").contains("fleetfoot\\-fit"));
        assert!(of("fleetfoot-fit-pwa.1").contains("\\-\\-partition"));
        assert!(of("fleetfoot-stats-merge.1").contains("EXTRA"), "the examples are missing");
    }
}
