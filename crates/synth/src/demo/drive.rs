//! The differential drive as a model. By the planar kinematics of equation (2) it predicts a hexapod's forward speed
//! and yaw rate from its cranks (Fig. 9a of Buchan, Haldane, Fearing, "Automatic Identification of Dynamic Piecewise
//! Affine Models for a Running Robot").

use std::path::PathBuf;

use fleetfoot_control::controller::DifferentialDrive;
use fleetfoot_data::Progress;
use fleetfoot_fit::Error;
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{Equation, Model, Prediction};
use fleetfoot_pwa::{Options, Problem};
use fleetfoot_recipe::Recipe;

use super::view;

/// The model, with mean and covariance of its predicted quantities in these logs: its score is
/// `D_M(X_D - X_D^, Sigma_XD)`. The recipe names the hexapod's truth. The speed is that over the belt.
///
/// # Errors
/// Logs that lack a needed column, and those of reading.
pub fn differential_drive(
    recipe: &Recipe,
    drive: &DifferentialDrive,
    files: &[PathBuf],
    progress: &dyn Progress,
) -> Result<Model, Error> {
    let columns: Result<Vec<_>, Error> = [
        ("speed", "vx + belt_speed*cos(yaw)", "m/s", false),
        ("yaw_rate", "wz", "rad/s", false),
        ("alpha_l", "alpha_l", "rad", true),
        ("alpha_r", "alpha_r", "rad", true),
        ("alpha_l_rate", "alpha_l_rate", "rad/s", false),
        ("alpha_r_rate", "alpha_r_rate", "rad/s", false),
    ]
    .iter()
    .map(|(name, text, unit, angle)| view::column(recipe, name, text, unit, *angle))
    .collect();
    let model = view::columns_only(recipe, "differential drive", columns?);
    let dataset = view::open(&model, files, progress)?;
    // A fit knows the scale of its targets; its coefficients are not wanted.
    let equation = |subject: &str, unit: &str| Equation {
        subject: subject.to_owned(),
        prediction: Prediction::Value,
        right: Expr::column(format!("f_{subject}")),
        target: Some(Expr::column(subject)),
        unit: Some(unit.to_owned()),
    };
    let problem = Problem {
        columns: model.columns.clone(),
        library: ["alpha_l_rate", "alpha_r_rate"].map(Expr::column).to_vec(),
        equations: vec![equation("speed", "m/s"), equation("yaw_rate", "rad/s")],
        partition_columns: Vec::new(),
        weight: None,
        step: dataset.step(),
    };
    let mut options = Options::default();
    options.folds = 0;
    let fitted = fleetfoot_pwa::identify(&problem, &options, &dataset.view()?, progress)?.model;
    let mut model = Model::new("differential drive", fitted.columns, fitted.step, fitted.training);
    model.training.recipe = recipe.to_toml();
    model.equations = problem.equations;
    let (radius, width) = (drive.radius, drive.width);
    let rights = [
        format!("{radius:?}/2*(alpha_l_rate + alpha_r_rate)"),
        format!("{radius:?}/{width:?}*(alpha_r_rate - alpha_l_rate)"),
    ];
    let scope = Scope::new(["alpha_l_rate", "alpha_r_rate"]);
    for (equation, text) in model.equations.iter_mut().zip(rights) {
        equation.right = Expr::parse(&text, &scope).map_err(|source| fleetfoot_recipe::Error::Expression {
            place: equation.subject.clone(),
            text,
            source,
        })?;
    }
    Ok(model)
}
