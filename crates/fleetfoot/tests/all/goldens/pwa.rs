//! `fit pwa`.

use fleetfoot::{FitReport, FitRequest, Fitted, Pwa, PwaReport, Recipe, Silent};

use super::{
    book::{Entry, check},
    logs::logs,
    recipe, refits,
};

/// A configuration: its name and its recipe.
struct Case {
    name: &'static str,
    recipe: &'static str,
}

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
            [pwa]
            select = "bic"
            unseen_labels = "pool"
        "#,
    },
    Case {
        name: "next values with lags, shrunk",
        recipe: r#"
            states = { v = {}, w = {} }
            inputs = { u = "u" }
            model = { predict = "next", lags = 2, partition = "kmeans:3" }
            pwa = { shrinkage = "auto", folds = 4 }
        "#,
    },
    Case {
        name: "differences of weighted angles, quadratic",
        recipe: r#"
            states = { v = {}, w = {}, phi = { kind = "angle" } }
            inputs = { u = "u", r = "r" }
            model = { predict = "delta", weight = "load", degree = 2, partition = "average,kmeans:2", partition_on = ["v", "phi"] }
            pwa = { folds = 8, purge = 0.03 }
        "#,
    },
    Case {
        name: "a column, by QR and without folds",
        recipe: r#"
            inputs = { v = "v", u = "u" }
            model = { predict = "dv", partition = "labels:mode" }
            pwa = { folds = 0, tsqr = true }
        "#,
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
            [pwa]
            seed = 7
            restarts = 3
            iterations = 5
            memory = 0.015625
            shrinkage = 10
        "#,
    },
    Case {
        name: "partition and span by rollouts",
        recipe: r#"
            states = { v = { derivative = { over = "auto" } } }
            inputs = { u = "u" }
            model = { partition = "average,kmeans:2" }
            pwa = { select = "rollout", horizon = 10 }
        "#,
    },
    Case {
        name: "central differences of order six",
        recipe: r#"
            states = { v = { derivative = "central6" }, w = { derivative = { over = 3 } } }
            inputs = { u = "u", r = "r" }
            model = { partition = "kmeans:2" }
            pwa = { folds = 5 }
        "#,
    },
];

fn fit(name: &str, recipe: &Recipe) -> Fitted<PwaReport> {
    let fitted = fleetfoot::fit::<Pwa>(recipe, &FitRequest::default(), &logs("robot", 0..5), &Silent);
    fitted.unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn entry(case: &Case) -> Entry {
    let fitted = fit(case.name, &recipe(case.recipe));
    refits(case.name, &fitted.model, |recipe| fit(case.name, recipe).model);
    let (model, report) = (&fitted.model, fitted.report.to_json());
    let mut entry = Entry::new(case.name);
    entry.model(model);
    entry.report("report", &report);
    entry.field("chosen", &report, "chosen");
    entry.field("folds", &report, "fold_rule");
    entry.field("loss", &report, "candidates/*/loss");
    entry.field("bic", &report, "candidates/*/bic");
    entry.field("mae over null", &report, "candidates/*/mae_over_null/*");
    entry.field("shrinkage", &report, "candidates/*/shrinkage");
    if case.recipe.contains("states") && !case.recipe.contains("phi") {
        entry.run(model, &logs("robot", 5..6));
    } else {
        entry.score(model, &logs("robot", 5..6));
        entry.predictions(model, &logs("robot", 5..6));
    }
    entry
}

#[test]
fn piecewise_affine_models_equal_goldens() {
    check("pwa.txt", "fit pwa", CASES.iter().map(entry).collect());
}
