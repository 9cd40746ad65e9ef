//! A model's equations as mathematics is set.

use fleetfoot_library::{Binary, Expr, Node, Unary};

use crate::{Basis, Definition, Equation, Latent, Model, Prediction};

/// Digits of a fitted coefficient in an equation for people; the model's file has all of them.
const DIGITS: usize = 4;

/// An equation as presentation MathML, in pieces between which a line may break. Each is the content of a `<math>` element; names are escaped.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct SetEquation {
    /// The left side with the sign of equality.
    pub left: String,
    /// The terms of the right side, each but the first with its sign.
    pub terms: Vec<String>,
}

impl Model {
    /// An equation. Where its right side is a fitted function alone, that function in a region stands there instead of its name.
    pub fn set_equation(&self, equation: &Equation, region: usize) -> SetEquation {
        let left = format!("{}<mo>=</mo>", left(equation));
        let terms = match self.latent_of(equation) {
            Some(latent) => summands(self, latent, region, DIGITS),
            None => split(&equation.right),
        };
        SetEquation { left, terms: signed(&terms) }
    }

    /// A fitted function in a region.
    pub fn set_latent(&self, latent: &Latent, region: usize) -> SetEquation {
        let left = format!("{}<mo>=</mo>", Expr::column(latent.name.as_str()).to_mathml());
        SetEquation { left, terms: signed(&summands(self, latent, region, DIGITS)) }
    }

    /// All equations. Those of fitted functions stand region by region, with the region's name if there are several.
    /// Then follow the functions that stand in no equation alone.
    pub fn set_equations(&self) -> Vec<(Option<&str>, SetEquation)> {
        let mut set = Vec::new();
        let alone: Vec<Option<&Latent>> = self.equations.iter().map(|equation| self.latent_of(equation)).collect();
        for (equation, latent) in self.equations.iter().zip(&alone) {
            let regions = latent.map_or(1, |latent| latent.map.regions());
            let name = |region: usize| latent.and_then(|latent| self.region_of_several(latent, region));
            set.extend((0..regions).map(|region| (name(region), self.set_equation(equation, region))));
        }
        let shared = |latent: &&Latent| alone.iter().flatten().all(|other| other.name != latent.name);
        for latent in self.latents.iter().filter(shared) {
            let name = |region: usize| self.region_of_several(latent, region);
            set.extend((0..latent.map.regions()).map(|region| (name(region), self.set_latent(latent, region))));
        }
        set
    }

    /// Name of a region of a function that has several.
    fn region_of_several(&self, latent: &Latent, region: usize) -> Option<&str> {
        let several = (latent.map.regions() > 1).then(|| self.summaries.get(latent.partition))??;
        several.regions.get(region).map(|region| region.name.as_str())
    }

    /// The terms of a function in a region: its constant (`None`), then its features, each with its coefficient, zeros among them.
    pub fn terms(&self, latent: &Latent, region: usize) -> Vec<(Option<Expr>, f64)> {
        let (map, library) = (&latent.map, self.libraries.get(latent.library).map_or(&[][..], Vec::as_slice));
        let features = (0..map.features()).map(|j| (map.feature(j, library), map.coefficient(region, j)));
        std::iter::once((None, map.constant(region))).chain(features).collect()
    }

    /// As [`Model::terms`], but for basis functions that mean nothing one by one ([`Basis::is_summed_up`]): their weighted sum is one term, `network_NAME` with the coefficient 1.
    pub fn terms_for_people(&self, latent: &Latent, region: usize) -> Vec<(Option<Expr>, f64)> {
        let mut terms = self.terms(latent, region);
        if let Some(basis) = latent.map.basis().filter(Basis::is_summed_up) {
            let terms_of_basis = terms.split_off(1 + latent.map.functions());
            if terms_of_basis.iter().any(|(_, value)| *value != 0.0) {
                terms.push((Some(Expr::column(format!("{}_{}", basis.kind(), latent.name))), 1.0));
            }
        }
        terms
    }

    /// The bases of the latents, with what each is; of those that several latents have, once.
    pub fn definitions(&self) -> Vec<Definition> {
        let mut known: Vec<(usize, Basis)> = Vec::new();
        for latent in &self.latents {
            let functions = latent.map.basis().map(|basis| (latent.library, basis));
            known.extend(functions.filter(|functions| !known.contains(functions)));
        }
        known.iter().map(|(library, basis)| basis.definition(&self.libraries[*library])).collect()
    }

    /// The fitted function that is all of an equation's right side.
    pub fn latent_of(&self, equation: &Equation) -> Option<&Latent> {
        let name = equation.right.as_column()?;
        self.latents.iter().find(|latent| latent.name == name)
    }
}

fn left(equation: &Equation) -> String {
    let subject = Expr::column(equation.subject.as_str());
    let upright = "<mi mathvariant=\"normal\">d</mi>";
    match equation.prediction {
        Prediction::Derivative => {
            format!("<mfrac><mrow>{upright}{}</mrow><mrow>{upright}<mi>t</mi></mrow></mfrac>", subject.to_mathml())
        }
        Prediction::Next => subject.shifted(-1).to_mathml(),
        Prediction::Difference => (subject.shifted(-1) - &subject).to_mathml(),
        Prediction::Value => subject.to_mathml(),
    }
}

/// A function in a region as terms: true for a subtracted one, and its absolute value with coefficients of so many
/// digits. Zeros are left out.
pub fn summands(model: &Model, latent: &Latent, region: usize, digits: usize) -> Vec<(bool, Expr)> {
    let term = |(function, value): (Option<Expr>, f64)| {
        let size = Expr::number(rounded(value.abs(), digits));
        (value < 0.0, function.map_or_else(|| size.clone(), |function| size.clone() * function))
    };
    let terms = model.terms_for_people(latent, region).into_iter().filter(|(_, value)| *value != 0.0);
    let terms: Vec<(bool, Expr)> = terms.map(term).collect();
    if terms.is_empty() { vec![(false, Expr::number(0.0))] } else { terms }
}

/// So many significant digits.
fn rounded(value: f64, digits: usize) -> f64 {
    let decimals = digits.saturating_sub(1);
    format!("{value:.decimals$e}").parse().unwrap_or(value)
}

/// An expression as the terms of its outermost sum.
fn split(expr: &Expr) -> Vec<(bool, Expr)> {
    let mut terms = Vec::new();
    let mut left = vec![(false, expr)];
    while let Some((negative, expr)) = left.pop() {
        match expr.node() {
            Node::Binary(Binary::Add, a, b) => left.extend([(negative, b), (negative, a)]),
            Node::Binary(Binary::Sub, a, b) => left.extend([(!negative, b), (negative, a)]),
            Node::Unary(Unary::Neg, x) => left.push((!negative, x)),
            _ => terms.push((negative, expr.clone())),
        }
    }
    terms
}

fn signed(terms: &[(bool, Expr)]) -> Vec<String> {
    let one = |(place, (negative, term)): (usize, &(bool, Expr))| {
        let sign = match (place, negative) {
            (0, false) => "",
            (0, true) => "<mo form=\"prefix\">\u{2212}</mo>",
            (_, false) => "<mo form=\"infix\">+</mo>",
            (_, true) => "<mo form=\"infix\">\u{2212}</mo>",
        };
        format!("{sign}{}", term.to_mathml())
    };
    terms.iter().enumerate().map(one).collect()
}

#[cfg(test)]
mod tests {
    use fleetfoot_library::{Expr, Scope};

    use super::split;
    use crate::{AffineMap, Column, Equation, Latent, Model, Prediction, Role, Training};

    #[test]
    fn fitted_functions_have_four_digits() {
        let column = Column::new("T", Role::State);
        let mut model = Model::new("sindy", vec![column], 0.1, Training::default());
        let temperature = Expr::column("T");
        model.libraries.push(vec![temperature.clone(), temperature.clone().powi(2)]);
        model.latents.push(Latent {
            beyond: Vec::new(),
            name: "f_T".into(),
            library: 0,
            partition: 0,
            map: AffineMap { constants: vec![10.00004, 0.0], coefficients: vec![vec![-0.512345, 0.0], vec![0.0, 0.0]] }
                .into(),
        });
        let (subject, right) = ("T".to_owned(), Expr::column("f_T"));
        model.equations.push(Equation { subject, prediction: Prediction::Next, right, target: None, unit: None });
        let set = model.set_equation(&model.equations[0], 0);
        assert!(set.left.ends_with("<mo>=</mo>") && set.left.contains("<mi>T</mi>"), "{set:?}");
        assert_eq!(set.terms.len(), 2, "a zero is left out: {set:?}");
        assert_eq!(set.terms[0], "<mn>10</mn>");
        assert!(set.terms[1].starts_with("<mo form=\"infix\">\u{2212}</mo><mn>0.5123</mn>"), "{set:?}");
        // A right side without terms is zero.
        assert_eq!(model.set_equation(&model.equations[0], 1).terms, ["<mn>0</mn>"]);
        assert!(model.set_latent(&model.latents[0], 0).left.contains("<mi>f</mi>"));
    }

    #[test]
    fn a_sum_splits_into_its_terms() {
        let expr = Expr::parse("a - (b - c*(d + e)) - -f", &Scope::open()).unwrap();
        let terms: Vec<String> = split(&expr)
            .iter()
            .map(|(negative, term)| format!("{}{term}", if *negative { "-" } else { "+" }))
            .collect();
        assert_eq!(terms, ["+a", "-b", "+c*(d + e)", "+f"]);
    }
}
