//! `fleetfoot demo`: the main job on a robot with known truth.

use fleetfoot::{Error, Recipe, fit_pwa, generate_demo, log::write_atomic, pwa::Options};

use super::{Context, fit, rollout, score};
use crate::args::{Demo, ModelData, Rollout, Score, TimeArgs};

pub(crate) fn demo(arguments: &Demo, context: &Context) -> Result<(), Error> {
    let folder = &arguments.output;
    context.say(format!("generating a wheeled robot's logs in {}", folder.display()));
    let files = generate_demo(folder, arguments.seed)?;
    let recipe = Recipe::read(&files.recipe)?;
    let mut options = Options::default();
    options.seed = arguments.seed;
    context.say(format!(
        "\n$ fleetfoot fit pwa -c {} {}",
        files.recipe.display(),
        folder.join("train_*.parquet").display()
    ));
    let bar = context.bar();
    let fitted = fit_pwa(&recipe, &options, 0.0, &files.training, &bar);
    bar.finish();
    let fitted = fitted?;
    let model = folder.join("model.json");
    write_atomic(&model, fitted.identification.model.to_json().as_bytes())?;
    context.notes(&fitted.notes);
    context.print(&fit::to_json(&fitted, &model), || fit::to_text(&fitted));
    let data = || ModelData { model: model.clone(), data: files.held_out.clone(), time: TimeArgs::default() };
    context.say(format!("\n$ fleetfoot score {} {}", model.display(), folder.join("test_*.parquet").display()));
    score::score(&Score { model: data(), episodes: false }, context)?;
    context.say(format!(
        "\n$ fleetfoot rollout {} {} --horizon 200",
        model.display(),
        folder.join("test_*.parquet").display()
    ));
    rollout::rollout(
        &Rollout {
            model: data(),
            horizon: 200,
            starts: std::num::NonZeroUsize::MIN.saturating_add(999),
            method: crate::args::Method::Euler,
            seed: None,
            output: None,
        },
        context,
    )?;
    context.say(format!("\n$ fleetfoot show {}    # the equations", model.display()));
    Ok(())
}
