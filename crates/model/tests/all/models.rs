//! Models of all kinds for the tests of export, made from seeds.

use fleetfoot_library::Expr;
use fleetfoot_model::{Activation, Branch, Cell, Cut, Model, Prediction, Role, Rule, Tree, UnseenLabel};

#[path = "maker.rs"]
mod maker;
pub(crate) use maker::Maker;

pub(crate) const STATE: Role = Role::State;
pub(crate) const INPUT: Role = Role::Input;

/// All kinds, each with a name that is a prefix.
pub(crate) fn all() -> Vec<(&'static str, Model)> {
    vec![
        ("sindy", sindy()),
        ("pwa", pwa(9, 1)),
        ("ball", ball()),
        ("boxed", boxed()),
        ("joined", joined()),
        ("tree", tree()),
        ("labels_tree", labels_tree()),
        ("labels_refuse", labels(UnseenLabel::Refuse)),
        ("labels_pool", labels(UnseenLabel::Pool)),
        ("narx", narx()),
        ("direct", direct()),
        ("aircraft", aircraft()),
        ("regression", regression()),
        ("piecewise", piecewise()),
        ("functions", functions()),
        ("given", given()),
        ("timed", timed()),
        ("mixed", mixed()),
        ("hostile", hostile()),
        ("constant", constant()),
        ("lagged_regression", lagged_regression()),
        ("beyond", beyond()),
        ("radial", radial()),
        ("radial_regions", radial_regions()),
        ("network", network(Activation::Tanh)),
        ("relu_network", network(Activation::Relu)),
        ("softplus_network", network(Activation::Softplus)),
        ("network_regions", network_regions()),
        ("rnn", recurrent(Cell::Rnn)),
        ("gru", recurrent(Cell::Gru)),
        ("lstm", recurrent(Cell::Lstm)),
        ("cell_regions", recurrent_regions(Cell::Gru)),
    ]
}

/// Radial functions of two of three functions, the sine of an angle among them, beside affine terms.
pub(crate) fn radial() -> Model {
    let mut maker = Maker::new(31, "pwa", &[("x", STATE), ("~a", STATE), ("u", INPUT)]);
    let library = maker.library(&["x", "sin(a)", "u"]);
    let partition = maker.partition("average", &[], Rule::Whole);
    maker.latent("f_x", library, partition, 2.0);
    maker.latent("f_a", library, partition, 2.0);
    maker.radial(&[1, 0], 7);
    maker.equation("x", Prediction::Derivative, "f_x - 0.1*x");
    maker.equation("a", Prediction::Derivative, "f_a");
    maker.finish()
}

/// The same radial functions with weights of three regions, in next values, and one of the functions has no other term.
pub(crate) fn radial_regions() -> Model {
    let mut maker = Maker::new(32, "pwa", &[("x", STATE), ("y", STATE), ("u", INPUT)]);
    let library = maker.library(&["x", "y", "u", "lag(x, 1)*u"]);
    let rule = maker.voronoi(3, 2);
    let partition = maker.partition("kmeans:3", &["x", "y"], rule);
    maker.latent("f_x", library, partition, 2.0);
    maker.latent("f_y", library, partition, 0.5);
    maker.radial(&[0, 1, 3], 5);
    maker.equation("x", Prediction::Next, "f_x");
    maker.equation("y", Prediction::Difference, "0.1*f_y");
    maker.finish()
}

/// A network of two layers over two of three functions beside affine terms.
pub(crate) fn network(activation: Activation) -> Model {
    let mut maker = Maker::new(33, "network 5-3", &[("x", STATE), ("~a", STATE), ("u", INPUT)]);
    let library = maker.library(&["x", "sin(a)", "u"]);
    let partition = maker.partition("average", &[], Rule::Whole);
    maker.latent("f_x", library, partition, 2.0);
    maker.latent("f_a", library, partition, 2.0);
    maker.network(&[1, 0], &[5, 3], activation);
    maker.equation("x", Prediction::Derivative, "f_x - 0.1*x");
    maker.equation("a", Prediction::Derivative, "f_a");
    maker.finish()
}

/// One layer with weights of three regions, over a lagged function too.
pub(crate) fn network_regions() -> Model {
    let mut maker = Maker::new(34, "network 6", &[("x", STATE), ("y", STATE), ("u", INPUT)]);
    let library = maker.library(&["x", "y", "u", "lag(x, 1)*u"]);
    let rule = maker.voronoi(3, 2);
    let partition = maker.partition("kmeans:3", &["x", "y"], rule);
    maker.latent("f_x", library, partition, 2.0);
    maker.latent("f_y", library, partition, 0.5);
    maker.network(&[0, 1, 3], &[6], Activation::Tanh);
    maker.equation("x", Prediction::Next, "f_x");
    maker.equation("y", Prediction::Difference, "0.1*f_y");
    maker.finish()
}

/// A cell over three rows of a state and an input; the linear map reads another state too.
pub(crate) fn recurrent(cell: Cell) -> Model {
    let mut maker = Maker::new(35, "network", &[("x", STATE), ("y", STATE), ("u", INPUT)]);
    let library = maker.library(&["x", "y", "u", "lag(x, 1)", "lag(u, 1)", "lag(x, 2)", "lag(u, 2)"]);
    let partition = maker.partition("average", &[], Rule::Whole);
    maker.latent("f_x", library, partition, 0.5);
    maker.latent("f_y", library, partition, 0.5);
    maker.recurrent(&[&[5, 6], &[3, 4], &[0, 2]], 4, cell);
    maker.equation("x", Prediction::Next, "f_x");
    maker.equation("y", Prediction::Difference, "f_y");
    maker.finish()
}

/// A cell whose steps both read the present row, with weights of three regions.
pub(crate) fn recurrent_regions(cell: Cell) -> Model {
    let mut maker = Maker::new(36, "network", &[("x", STATE), ("y", STATE), ("u", INPUT)]);
    let library = maker.library(&["x", "y", "u", "lag(x, 1)*u", "lag(y, 1)", "lag(u, 1)"]);
    let rule = maker.voronoi(3, 2);
    let partition = maker.partition("kmeans:3", &["x", "y"], rule);
    maker.latent("f_x", library, partition, 2.0);
    maker.latent("f_y", library, partition, 0.5);
    maker.recurrent(&[&[4, 5], &[0, 1], &[3, 2]], 3, cell);
    maker.equation("x", Prediction::Next, "f_x");
    maker.equation("y", Prediction::Difference, "0.1*f_y");
    maker.finish()
}

/// Polynomials and trigonometric terms, mostly zero.
pub(crate) fn sindy() -> Model {
    let mut maker = Maker::new(1, "sindy", &[("x", STATE), ("y", STATE), ("z", STATE), ("u", INPUT)]);
    let library = maker.library(&[
        "x",
        "y",
        "z",
        "x^2",
        "x*y",
        "x*z",
        "y^2",
        "y*z",
        "z^2",
        "x^3",
        "x^2*y",
        "sin(x)",
        "cos(y)",
        "sin(x)*cos(y)",
        "exp(-z)",
        "u",
        "u*x",
        "u^2*z",
        "tanh(x + y)",
        "x^7",
    ]);
    let whole = maker.partition("average", &[], Rule::Whole);
    for (latent, subject) in [("f_x", "x"), ("f_y", "y"), ("f_z", "z")] {
        maker.latent(latent, library, whole, 0.3);
        maker.equation(subject, Prediction::Derivative, latent);
    }
    maker.finish()
}

/// Affine maps with an angle in them, nearest centroid.
pub(crate) fn pwa(regions: usize, seed: u64) -> Model {
    let columns =
        [("px", STATE), ("vx", STATE), ("vy", STATE), ("~yaw", STATE), ("w", STATE), ("left", INPUT), ("right", INPUT)];
    let mut maker = Maker::new(seed, "pwa kmeans", &columns);
    let library = maker.library(&["vx", "vy", "w", "cos(yaw)", "sin(yaw)", "left", "right"]);
    let rule = maker.voronoi(regions, 4);
    let partition = maker.partition("kmeans", &["vx", "w", "cos(yaw)", "left"], rule);
    maker.equation("px", Prediction::Derivative, "vx*cos(yaw) - vy*sin(yaw)");
    for (latent, subject) in [("f_vx", "vx"), ("f_vy", "vy"), ("f_w", "w")] {
        maker.latent(latent, library, partition, 1.0);
        maker.equation(subject, Prediction::Derivative, latent);
    }
    maker.equation("yaw", Prediction::Derivative, "3*w");
    maker.finish()
}

/// The same with other slopes outside of narrow ranges, which most points leave.
pub(crate) fn beyond() -> Model {
    let mut model = pwa(4, 17);
    for range in
        model.summaries.iter_mut().flat_map(|summary| &mut summary.regions).flat_map(|region| &mut region.range)
    {
        let (centre, half) = ((range[0] + range[1]) / 2.0, (range[1] - range[0]) / 8.0);
        *range = [centre - half, centre + half];
    }
    for (at, latent) in model.latents.iter_mut().enumerate() {
        // One function counts outside of the ranges alone.
        latent.beyond = (0..latent.map.features()).map(|j| 0.3 * j as f64 - 0.2 * at as f64).collect();
    }
    model.validate().unwrap_or_else(|problem| panic!("{problem}"));
    model
}

/// The z-score ball, next values.
fn ball() -> Model {
    let mut maker = Maker::new(3, "pwa zscore", &[("a", STATE), ("b", STATE), ("u", INPUT)]);
    let library = maker.library(&["a", "b", "u"]);
    let partition = maker.partition("zscore", &["a", "b"], Rule::Ball { radius: 1.3 });
    maker.latent("f_a", library, partition, 1.0);
    maker.latent("f_b", library, partition, 1.0);
    maker.equation("a", Prediction::Next, "f_a");
    maker.equation("b", Prediction::Difference, "0.1*f_b - 0.2*f_a*b");
    maker.finish()
}

/// The z-score box, as a division of labels too.
fn boxed() -> Model {
    let mut maker = Maker::new(12, "pwa zbox", &[("a", STATE), ("b", STATE), ("u", INPUT), ("mode", INPUT)]);
    let library = maker.library(&["a", "b", "u"]);
    let plain = maker.partition("zbox", &["a", "b"], Rule::Box { half: 0.8 });
    let rule = Rule::Labels {
        values: vec![0.0, 1.0],
        names: vec!["ice".into(), "grass".into()],
        rules: vec![Rule::Box { half: 0.6 }, Rule::Box { half: 1.1 }],
        unseen: UnseenLabel::Refuse,
    };
    let labels = maker.partition("labels:mode", &["a", "b", "mode"], rule);
    maker.latent("f_a", library, plain, 1.0);
    maker.latent("f_b", library, labels, 1.0);
    maker.equation("a", Prediction::Next, "f_a");
    maker.equation("b", Prediction::Difference, "0.1*f_b - 0.2*f_a*b");
    maker.finish()
}

/// Cells joined to regions, next values.
fn joined() -> Model {
    let mut maker = Maker::new(6, "pwa lattice", &[("a", STATE), ("b", STATE), ("u", INPUT)]);
    let library = maker.library(&["a", "b", "u"]);
    let rule = Rule::Joined { cells: maker.voronoi(7, 2).into(), regions: vec![0, 1, 2, 1, 0, 2, 1] };
    let partition = maker.partition("lattice:3", &["a", "b"], rule);
    maker.latent("f_a", library, partition, 1.0);
    maker.latent("f_b", library, partition, 1.0);
    maker.equation("a", Prediction::Next, "f_a");
    maker.equation("b", Prediction::Difference, "0.1*f_b - 0.2*f_a*b");
    maker.finish()
}

/// Cuts: `a < 0.3 ? (b < -0.2 ? 0 : 1) : (a < 0.8 ? 2 : 3)`.
fn cuts() -> Rule {
    let cut = |column, threshold, below, above| Cut { column, threshold, below, above };
    Rule::Tree(Tree {
        cuts: vec![
            cut(0, 0.3, Branch::Cut(1), Branch::Cut(2)),
            cut(1, -0.2, Branch::Region(0), Branch::Region(1)),
            cut(0, 0.8, Branch::Region(2), Branch::Region(3)),
        ],
    })
}

/// Columns as they are.
fn in_their_units(maker: &mut Maker, partition: usize) {
    let partition = &mut maker.model.partitions[partition];
    partition.centre.fill(0.0);
    partition.scale.fill(1.0);
}

/// A tree of cuts over a column and an expression, next values.
fn tree() -> Model {
    let mut maker = Maker::new(8, "pwa tree", &[("a", STATE), ("b", STATE), ("u", INPUT)]);
    let library = maker.library(&["a", "b", "u"]);
    let partition = maker.partition("tree:2", &["a", "b + u"], cuts());
    in_their_units(&mut maker, partition);
    maker.latent("f_a", library, partition, 1.0);
    maker.latent("f_b", library, partition, 1.0);
    maker.equation("a", Prediction::Next, "f_a");
    maker.equation("b", Prediction::Difference, "0.1*f_b - 0.2*f_a*b");
    maker.finish()
}

/// By label, then a tree for one of them.
fn labels_tree() -> Model {
    let columns = [("v", STATE), ("w", STATE), ("u", INPUT), ("ground", Role::Auxiliary)];
    let mut maker = Maker::new(9, "pwa labels", &columns);
    let library = maker.library(&["v", "w", "u"]);
    let rule = Rule::Labels {
        values: vec![-1.0, 0.0, 2.0],
        names: vec!["ice".into(), "grass".into(), "road".into()],
        rules: vec![cuts(), Rule::Whole, cuts()],
        unseen: UnseenLabel::Pool,
    };
    let partition = maker.partition("labels:ground+tree:2", &["v", "w", "ground"], rule);
    in_their_units(&mut maker, partition);
    maker.latent("f_v", library, partition, 1.0);
    maker.equation("v", Prediction::Derivative, "f_v");
    maker.finish()
}

/// By label, then a rule for each.
fn labels(unseen: UnseenLabel) -> Model {
    let columns = [("v", STATE), ("w", STATE), ("u", INPUT), ("ground", Role::Auxiliary)];
    let mut maker = Maker::new(4, "pwa labels", &columns);
    let library = maker.library(&["v", "w", "u"]);
    let (first, second) = (maker.voronoi(3, 2), Rule::Ball { radius: 1.0 });
    let rule = Rule::Labels {
        values: vec![-1.0, 0.0, 2.0],
        names: vec!["ice".into(), "grass".into(), "road".into()],
        rules: vec![first, Rule::Whole, second],
        unseen,
    };
    let partition = maker.partition("labels:ground+kmeans:3", &["v", "w", "ground"], rule);
    maker.latent("f_v", library, partition, 1.0);
    maker.latent("f_w", library, partition, 1.0);
    maker.equation("v", Prediction::Derivative, "f_v");
    maker.equation("w", Prediction::Derivative, "f_w");
    maker.finish()
}

/// A polynomial of lags.
fn narx() -> Model {
    let mut maker = Maker::new(5, "narx", &[("y", STATE), ("u", INPUT)]);
    let library = maker.library(&[
        "y",
        "lag(y, 1)",
        "lag(y, 2)",
        "u",
        "lag(u, 1)",
        "lag(u, 3)",
        "y*lag(y, 1)",
        "u*lag(y, 2)",
        "lag(u, 1)^2*y",
    ]);
    let whole = maker.partition("average", &[], Rule::Whole);
    maker.latent("f_y", library, whole, 0.8);
    maker.equation("y", Prediction::Next, "f_y");
    maker.finish()
}

/// Inputs that act at once: those of the row that is stepped to, alone and with those before.
fn direct() -> Model {
    let mut maker = Maker::new(21, "narx", &[("y", STATE), ("z", STATE), ("u", INPUT), ("w", INPUT)]);
    let library = maker.library(&[
        "y",
        "lag(y, 1)",
        "z",
        "lead(u, 1)",
        "u",
        "lag(u, 1)",
        "lead(u, 1)^2*y",
        "lead(w, 1)*lag(w, 2)",
    ]);
    let rule = maker.voronoi(3, 2);
    let partition = maker.partition("kmeans:3", &["y", "lead(u, 1)"], rule);
    maker.latent("f_y", library, partition, 1.0);
    maker.latent("f_z", library, partition, 1.0);
    maker.equation("y", Prediction::Next, "f_y");
    maker.equation("z", Prediction::Difference, "f_z");
    maker.finish()
}

/// Latents shared between equations, and an output.
fn aircraft() -> Model {
    let columns = [
        ("V", STATE),
        ("gamma", STATE),
        ("m", STATE),
        ("h", STATE),
        ("alpha", INPUT),
        ("N1", INPUT),
        ("rho", INPUT),
        ("lift", Role::Auxiliary),
    ];
    let mut maker = Maker::new(6, "sparse", &columns);
    let thrust = maker.library(&["N1", "N1*rho", "N1*V", "N1*V^2", "N1*rho*V"]);
    let drag = maker.library(&["V^2", "V^2*alpha", "V^2*alpha^2", "V^2*alpha^3"]);
    let average = maker.partition("average", &[], Rule::Whole);
    let other = maker.partition("average", &[], Rule::Whole);
    maker.latent("T", thrust, average, 0.8);
    maker.latent("D", drag, other, 0.8);
    maker.latent("L", drag, other, 0.8);
    maker.equation("V", Prediction::Derivative, "(T*cos(alpha) - D)/(m + 3) - 9.80665*sin(gamma)");
    maker.equation(
        "gamma",
        Prediction::Derivative,
        "(T*sin(alpha) + L)/((m + 3)*(V + 5)) - 9.80665/(V + 5)*cos(gamma)",
    );
    maker.equation("m", Prediction::Derivative, "-T/(50 + L^2)");
    maker.equation("h", Prediction::Derivative, "V*sin(gamma)");
    maker.equation("lift", Prediction::Value, "L*cos(alpha) + T*sin(alpha)");
    maker.finish()
}

/// y = f(x).
fn regression() -> Model {
    let columns = [("a", INPUT), ("b", INPUT), ("force", Role::Auxiliary), ("torque", Role::Auxiliary)];
    let mut maker = Maker::new(7, "sparse", &columns);
    let library = maker.library(&["a", "b", "a*b", "sqrt(abs(a) + 1)", "a^-2*b"]);
    let rule = maker.separators(4, 2);
    let partition = maker.partition("kmeans:4", &["a", "b"], rule);
    maker.latent("f", library, partition, 1.0);
    maker.latent("g", library, partition, 1.0);
    maker.equation("force", Prediction::Value, "f");
    maker.equation("torque", Prediction::Value, "2*g - f*a");
    maker.finish()
}

/// Sparse equations in the regions of two partitions.
fn piecewise() -> Model {
    let mut maker = Maker::new(8, "piecewise", &[("p", STATE), ("q", STATE), ("u", INPUT)]);
    let first = maker.library(&["p", "q", "p^2", "p*q", "q^2", "sin(p)", "cos(q)", "u", "u*p", "u*q", "p^3", "q^3"]);
    let second = maker.library(&["p", "q", "abs(p)", "sign(q)*q^2", "u"]);
    let (rule, ball) = (maker.voronoi(12, 2), Rule::Ball { radius: 1.4 });
    let cells = maker.partition("kmeans:12", &["p", "q"], rule);
    let ball = maker.partition("zscore", &["q", "u"], ball);
    maker.latent("f_p", first, cells, 0.25);
    maker.latent("f_q", second, ball, 1.0);
    maker.latent("g_q", first, cells, 0.25);
    maker.equation("p", Prediction::Derivative, "f_p");
    maker.equation("q", Prediction::Derivative, "f_q + g_q*p");
    maker.finish()
}

/// Every elementary function.
fn functions() -> Model {
    let mut maker = Maker::new(9, "sindy", &[("x", STATE), ("~th", STATE), ("u", INPUT)]);
    let library = maker.library(&[
        "sin(x)",
        "cos(x)",
        "tan(x/2)",
        "asin(x/4)",
        "acos(u/4)",
        "atan(x)",
        "sinh(x)",
        "cosh(x)",
        "tanh(u)",
        "exp(x)",
        "log(x + 3)",
        "sqrt(u + 4)",
        "abs(x)",
        "sign(x - 0.3)",
        "step(u + 0.2)",
        "wrap(7*th)",
        "atan2(x, u)",
        "min(x, u)",
        "max(x, u*x)",
        "(x + 3)^u",
        "(x + 3)^1.5",
        "x - (u - x)",
        "x/(u + 5)",
        "-x*(-u)",
        "2 - (-x)",
    ]);
    let whole = maker.partition("average", &[], Rule::Whole);
    maker.latent("f", library, whole, 1.0);
    maker.latent("g", library, whole, 1.0);
    maker.equation("x", Prediction::Derivative, "f");
    maker.equation("th", Prediction::Derivative, "20*g");
    maker.finish()
}

/// Nothing fitted.
fn given() -> Model {
    let columns = [("x", STATE), ("y", STATE), ("~yaw", STATE), ("v", INPUT), ("w", INPUT)];
    let mut maker = Maker::new(10, "given", &columns);
    maker.equation("x", Prediction::Derivative, "v*cos(yaw)");
    maker.equation("y", Prediction::Derivative, "v*sin(yaw)");
    maker.equation("yaw", Prediction::Derivative, "w");
    maker.finish()
}

/// Time and earlier times.
fn timed() -> Model {
    let mut maker = Maker::new(11, "sindy", &[("x", STATE), ("u", INPUT)]);
    let library = maker.library(&["x", "sin(2*time())", "lag(time(), 2)*x", "lag(u, 1)"]);
    let whole = maker.partition("average", &[], Rule::Whole);
    maker.latent("f", library, whole, 1.0);
    maker.equation("x", Prediction::Derivative, "f - 0.1*time()");
    maker.finish()
}

/// A derivative and a next value.
fn mixed() -> Model {
    let mut maker = Maker::new(12, "mixed", &[("x", STATE), ("n", STATE), ("u", INPUT)]);
    let library = maker.library(&["x", "n", "u"]);
    let rule = maker.voronoi(3, 2);
    let partition = maker.partition("kmeans:3", &["x", "n"], rule);
    maker.latent("f", library, partition, 1.0);
    maker.latent("g", library, partition, 1.0);
    maker.equation("x", Prediction::Derivative, "f");
    maker.equation("n", Prediction::Next, "0.5*g");
    maker.finish()
}

/// Names that are no identifiers, clash, or try to leave a comment.
fn hostile() -> Model {
    let names = [
        ("/odom.twist[0]", STATE),
        ("class", STATE),
        ("CLASS", STATE),
        ("*/ int x; /*", INPUT),
        ("é\u{202e}\\", INPUT),
        ("\"\"\"\nimport os", INPUT),
        ("count", INPUT),
        ("??/", INPUT),
        ("lambda", INPUT),
        ("", INPUT),
    ];
    let mut maker = Maker::new(13, "sindy */ #error \"no\" \\", &names);
    let quoted: Vec<String> = names.iter().map(|name| Expr::column(name.0).to_string()).collect();
    let library: Vec<&str> = quoted.iter().map(String::as_str).filter(|name| *name != "``").collect();
    let library = maker.library(&library);
    let whole = maker.partition("*/ \u{2028}??/", &[], Rule::Whole);
    for (latent, subject) in [("f", "/odom.twist[0]"), ("g", "class"), ("h", "CLASS")] {
        maker.latent(latent, library, whole, 1.0);
        maker.equation(subject, Prediction::Derivative, latent);
    }
    maker.finish()
}

/// A right side that reads nothing.
fn constant() -> Model {
    let mut maker = Maker::new(14, "constant", &[("x", STATE)]);
    let library = maker.library(&[]);
    let whole = maker.partition("average", &[], Rule::Whole);
    maker.latent("f", library, whole, 1.0);
    maker.equation("x", Prediction::Derivative, "f");
    maker.finish()
}

/// An output of lags of itself: the past is observed.
fn lagged_regression() -> Model {
    let mut maker = Maker::new(15, "narx", &[("u", INPUT), ("y", Role::Auxiliary)]);
    let library = maker.library(&["lag(y, 1)", "lag(y, 2)", "u", "lag(u, 2)"]);
    let whole = maker.partition("average", &[], Rule::Whole);
    maker.latent("f", library, whole, 1.0);
    maker.equation("y", Prediction::Value, "f");
    maker.finish()
}
