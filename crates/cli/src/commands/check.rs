//! `fleetfoot check`.

use fleetfoot::{Checked, Error, Finding, Recipe, check};

use super::{Context, files, flags};
use crate::{
    args::Check,
    table::{count, number, table},
};

pub(crate) fn run(arguments: &Check, context: &Context) -> Result<(), Error> {
    let files = files(&arguments.data)?;
    let mut recipe = arguments.recipe.as_deref().map_or_else(|| Ok(Recipe::default()), Recipe::read)?;
    flags::apply_time(&mut recipe, &arguments.time)?;
    if let Some(first) = files.first() {
        recipe.cache = flags::cache(&arguments.time.channels, first);
    }
    let bar = context.bar();
    let checked = check(&recipe, &files, &bar);
    bar.finish();
    let checked = checked?;
    context.notes(&checked.notes);
    context.print(&checked, || to_text(&checked));
    match (arguments.strict, checked.findings.len()) {
        (true, wrong) if wrong > 0 => Err(Error::value(format!("--strict: {} in these logs", count(wrong, "finding")))),
        _ => Ok(()),
    }
}

pub(crate) fn to_text(checked: &Checked) -> String {
    let rate = if checked.period > 0.0 { format!(", {} Hz", number(1.0 / checked.period)) } else { String::new() };
    let mut text = format!(
        "{}, {}, {} rows{rate}; {} looked at\n",
        count(checked.files, "file"),
        count(checked.episodes, "episode"),
        checked.rows,
        count(checked.channels.len(), "channel"),
    );
    let rows = checked.channels.iter().map(|channel| {
        let [least, most] = channel.range.map(number);
        vec![
            channel.name.clone(),
            channel.unit.clone().unwrap_or_default(),
            least,
            most,
            number(channel.deviation),
            format!("{:.1} %", 100.0 * channel.moves),
            format!("{:.1} %", 100.0 * channel.missing),
        ]
    });
    text.push_str(&table(&["channel", "unit", "least", "most", "deviation", "moves", "missing"], rows.collect()));
    text.push('\n');
    for Finding { place, what, mend, .. } in &checked.findings {
        text.push_str(&format!("\n{place}: {what}\n  -> {mend}"));
    }
    text.push_str(&match checked.findings.len() {
        0 => "\nNothing wrong was found.".to_owned(),
        wrong => format!("\n\n{}.", count(wrong, "finding")),
    });
    text
}
