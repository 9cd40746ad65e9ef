//! `fit pwa`.

use fleetfoot::{
    Fitted, RolloutRule, Silent, fit_pwa, fit_pwa_by_rollouts,
    model::UnseenLabel,
    pwa::{Options, Selection, Shrinkage},
};

use super::{
    book::{Entry, check},
    logs::logs,
    recipe,
};

/// A configuration: its name, its recipe, and what is no part of a recipe.
struct Case {
    name: &'static str,
    recipe: &'static str,
    options: fn(&mut Options),
    purge: Option<f64>,
    rollouts: Option<usize>,
}

const NOTHING: Case = Case { name: "", recipe: "", options: |_| {}, purge: None, rollouts: None };

/// Between them: every partition, ways to choose one, folds of spans and of episodes, what is predicted, lags, angles, weights, given equations, k-means on a sample.
const CASES: [Case; 8] = [
    Case {
        name: "the order by cross-validation",
        recipe: r#"
            [states]
            x = { known = "v", regressor = false }
            v = { derivative = "forward" }
            [inputs]
            u = "u"
            [model]
            partition = "null,average,kmeans:2,3,5"
            partition_on = ["v"]
        "#,
        ..NOTHING
    },
    Case {
        name: "balls and labels by BIC",
        recipe: r#"
            [states]
            v = { derivative = "dv" }
            w = { derivative = "dw" }
            [inputs]
            u = "u"
            r = "r"
            [model]
            partition = "zscore:1.5,labels:mode,labels:mode+kmeans:2"
        "#,
        options: |options| {
            options.selection = Selection::Bic;
            options.unseen = UnseenLabel::Pool;
        },
        ..NOTHING
    },
    Case {
        name: "next values with lags, shrunk",
        recipe: r#"
            states = { v = {}, w = {} }
            inputs = { u = "u" }
            model = { predict = "next", lags = 2, partition = "kmeans:3" }
        "#,
        options: |options| {
            options.shrinkage = Shrinkage::Auto;
            options.folds = 4;
        },
        ..NOTHING
    },
    Case {
        name: "differences of weighted angles, quadratic",
        recipe: r#"
            states = { v = {}, w = {}, phi = { kind = "angle" } }
            inputs = { u = "u", r = "r" }
            model = { predict = "delta", weight = "load", degree = 2, partition = "average,kmeans:2", partition_on = ["v", "phi"] }
        "#,
        options: |options| options.folds = 8,
        purge: Some(0.03),
        ..NOTHING
    },
    Case {
        name: "a column, by QR and without folds",
        recipe: r#"
            inputs = { v = "v", u = "u" }
            model = { predict = "dv", partition = "labels:mode" }
        "#,
        options: |options| {
            options.folds = 0;
            options.tsqr = true;
        },
        ..NOTHING
    },
    Case {
        name: "k-means of a sample, restarted",
        recipe: r#"
            [states]
            v = { derivative = "dv" }
            w = { derivative = "dw" }
            [inputs]
            u = "u"
            r = "r"
            [model]
            partition = "kmeans:4"
            partition_on = ["v", "w", "u"]
        "#,
        options: |options| {
            options.seed = 7;
            options.restarts = 3;
            options.iterations = 5;
            options.memory = 16 << 10;
            options.shrinkage = Shrinkage::Rows(10.0);
        },
        ..NOTHING
    },
    Case {
        name: "partition and span by rollouts",
        recipe: r#"
            states = { v = { derivative = { over = "auto" } } }
            inputs = { u = "u" }
            model = { partition = "average,kmeans:2" }
        "#,
        rollouts: Some(10),
        ..NOTHING
    },
    Case {
        name: "central differences of order six",
        recipe: r#"
            states = { v = { derivative = "central6" }, w = { derivative = { over = 3 } } }
            inputs = { u = "u", r = "r" }
            model = { partition = "kmeans:2" }
        "#,
        options: |options| options.folds = 5,
        ..NOTHING
    },
];

fn fit(case: &Case) -> Fitted {
    let mut options = Options::default();
    (case.options)(&mut options);
    let (recipe, logs) = (recipe(case.recipe), logs("robot", 0..5));
    let fitted = match case.rollouts {
        None => fit_pwa(&recipe, &options, case.purge, &logs, &Silent),
        Some(steps) => fit_pwa_by_rollouts(&recipe, &options, case.purge, RolloutRule::new(steps), &logs, &Silent),
    };
    fitted.unwrap_or_else(|error| panic!("{}: {error}", case.name))
}

fn entry(case: &Case) -> Entry {
    let fitted = fit(case);
    let (model, report) = (&fitted.identification.model, fitted.to_json());
    let mut entry = Entry::new(case.name);
    entry.model(model);
    entry.report("report", &report);
    entry.told("chosen", &report, "chosen");
    entry.told("folds", &report, "fold_rule");
    entry.told("loss", &report, "candidates/*/loss");
    entry.told("bic", &report, "candidates/*/bic");
    entry.told("mae over null", &report, "candidates/*/mae_over_null/*");
    entry.told("shrinkage", &report, "candidates/*/shrinkage");
    if case.recipe.contains("states") && !case.recipe.contains("phi") {
        entry.run(model, &logs("robot", 5..6));
    } else {
        entry.score(model, &logs("robot", 5..6));
        entry.predictions(model, &logs("robot", 5..6));
    }
    entry
}

#[test]
fn piecewise_affine_models_are_what_they_were() {
    check("pwa.txt", "fit pwa", CASES.iter().map(entry).collect());
}
