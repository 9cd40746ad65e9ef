//! Partitions as canonical bytes, for hashes of plans that were frozen before a scan.

use fleetfoot_data::Canonical;

use crate::{Partition, Rule, Tree, UnseenLabel};

impl Partition {
    /// Adds the numbers by which rows find their regions.
    pub fn encode_rule(&self, out: &mut Canonical) {
        self.rule.encode(out);
        out.numbers(&self.centre);
        out.numbers(&self.scale);
    }
}

impl Rule {
    fn encode(&self, out: &mut Canonical) {
        match self {
            Self::Whole => out.tag(0),
            Self::Ball { radius } => {
                out.tag(1);
                out.number(*radius);
            }
            Self::Linear { weights, offsets } => {
                out.tag(2);
                out.count(weights.len() as u64);
                weights.iter().for_each(|weight| out.numbers(weight));
                out.numbers(offsets);
            }
            Self::Joined { cells, regions } => {
                out.tag(3);
                cells.encode(out);
                out.count(regions.len() as u64);
                regions.iter().for_each(|&region| out.count(region.into()));
            }
            Self::Tree(Tree { cuts }) => {
                out.tag(4);
                out.count(cuts.len() as u64);
                for cut in cuts {
                    out.count(cut.column as u64);
                    out.number(cut.threshold);
                    [cut.below, cut.above].into_iter().for_each(|branch| out.count(branch.code() as u64));
                }
            }
            Self::Box { half } => {
                out.tag(6);
                out.number(*half);
            }
            Self::Labels { values, names, rules, unseen } => {
                out.tag(5);
                out.numbers(values);
                out.count(names.len() as u64);
                names.iter().for_each(|name| out.text(name));
                out.count(rules.len() as u64);
                rules.iter().for_each(|rule| rule.encode(out));
                out.tag(match unseen {
                    UnseenLabel::Refuse => 0,
                    UnseenLabel::Pool => 1,
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn different_rules_have_different_bytes() {
        let linear = |weights: Vec<Vec<f64>>, offsets| Rule::Linear { weights, offsets };
        let labels =
            |unseen| Rule::Labels { values: vec![1.0], names: vec!["grass".into()], rules: vec![Rule::Whole], unseen };
        let all = [
            Rule::Whole,
            Rule::Ball { radius: 1.0 },
            Rule::Ball { radius: 2.0 },
            Rule::Box { half: 2.0 },
            linear(vec![vec![1.0, 2.0]], vec![0.0]),
            linear(vec![vec![1.0], vec![2.0]], vec![0.0]),
            Rule::Joined { cells: Rule::Whole.into(), regions: vec![0] },
            labels(UnseenLabel::Refuse),
            labels(UnseenLabel::Pool),
        ];
        let bytes = all.map(|rule| {
            let mut out = Canonical::default();
            rule.encode(&mut out);
            out
        });
        for (at, one) in bytes.iter().enumerate() {
            assert!(bytes[..at].iter().all(|other| other != one), "{at}");
        }
    }
}
