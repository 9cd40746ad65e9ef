//! Partitions as users write them: `null`, `average`, `zscore:1.5`, `zbox:1.5`, `kmeans:10`, `kmeans:2,5,10`, `refined:5`, `refined:2..20`,
//! `lattice:2..50`, `tree:3`, `labels:terrain`, `labels:terrain+kmeans:5`, `labels:terrain+refined:5`, `labels:terrain+tree:3`.

use std::{fmt, str::FromStr};

/// A kind of partition to fit.
#[derive(Debug, Clone, PartialEq)]
pub enum Specification {
    /// No dynamics: the mean of each target.
    Null,
    /// One affine model for all.
    Average,
    /// Inside and outside a ball of this radius in z-score space.
    ZScore(f64),
    /// Inside and outside a box: every column within this many standard deviations of its mean, or not.
    ZBox(f64),
    /// Voronoi cells of k-means centroids.
    KMeans(usize),
    /// Regions that fit the dynamics, between linear separators.
    Refined(usize),
    /// Small cells, joined where one map fits both.
    Lattice(usize),
    /// Cuts of single columns, at most so many one after another, that fit the dynamics.
    Tree(usize),
    /// One region per value of a column, or several if these are divided.
    Labels {
        /// The column.
        column: String,
        /// Division of the rows of a label.
        within: Within,
    },
}

/// Division of the rows of a label.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Within {
    /// Not at all.
    Whole,
    /// By k-means.
    KMeans(usize),
    /// Into regions that fit the dynamics.
    Refined(usize),
    /// By a tree of cuts.
    Tree(usize),
}

/// Why a partition could not be understood.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "partition `{text}`: {problem}; write null, average, zscore:1.5, zbox:1.5, kmeans:10, kmeans:2,5,10, refined:5, refined:2..20, lattice:2..50, tree:3, \
     tree:1..6, labels:COLUMN, labels:COLUMN+kmeans:5, labels:COLUMN+refined:5 or labels:COLUMN+tree:3"
)]
pub struct SpecificationError {
    text: String,
    problem: String,
}

impl Specification {
    /// Parses a list such as `average,zscore:1.5,kmeans:2,5,10,refined:2..20`: bare numbers continue the entry before
    /// them, and a range includes both ends.
    ///
    /// # Errors
    /// A text that names no partition; the message lists those that exist.
    pub fn parse_list(text: &str) -> Result<Vec<Self>, SpecificationError> {
        let mut list: Vec<Self> = Vec::new();
        for item in text.split(',').map(str::trim) {
            let (kind, numbers) = item.rsplit_once(':').map_or((None, item), |(kind, numbers)| (Some(kind), numbers));
            let counts = counts(item, numbers)?;
            match (kind, list.last().cloned()) {
                (Some(kind), _) if numbers.contains("..") && !counts.is_empty() => {
                    for count in counts {
                        list.push(format!("{kind}:{count}").parse()?);
                    }
                }
                (None, Some(last)) if !counts.is_empty() && last.clusters().is_some() => {
                    let last = last.to_string();
                    let kind = last.rsplit_once(':').map_or(last.as_str(), |(kind, _)| kind);
                    for count in counts {
                        list.push(format!("{kind}:{count}").parse()?);
                    }
                }
                _ => list.push(item.parse()?),
            }
        }
        Ok(list)
    }

    /// The label column that it needs.
    pub fn label(&self) -> Option<&str> {
        match self {
            Self::Labels { column, .. } => Some(column),
            _ => None,
        }
    }

    /// Number of regions to search for (within each label), if it is not fixed by the columns. Of a tree: its most
    /// leaves.
    pub fn clusters(&self) -> Option<usize> {
        match self {
            Self::KMeans(k) | Self::Refined(k) | Self::Lattice(k) => Some(*k),
            Self::Labels { within: Within::KMeans(k) | Within::Refined(k), .. } => Some(*k),
            Self::Tree(depth) | Self::Labels { within: Within::Tree(depth), .. } => Some(1 << depth),
            _ => None,
        }
    }

    /// Returns true if its regions depend on the targets too, not only on the places of rows.
    pub fn fits_targets(&self) -> bool {
        matches!(
            self,
            Self::Refined(_)
                | Self::Lattice(_)
                | Self::Tree(_)
                | Self::Labels { within: Within::Refined(_) | Within::Tree(_), .. }
        )
    }

    /// The cells of k-means that its refinement starts from; `None` unless it is refined.
    pub fn refined_from(&self) -> Option<Self> {
        match self {
            Self::Refined(k) => Some(Self::KMeans(*k)),
            Self::Labels { column, within: Within::Refined(k) } => {
                Some(Self::Labels { column: column.clone(), within: Within::kmeans(*k) })
            }
            _ => None,
        }
    }

    /// Returns true if its regions depend on a seed too.
    pub fn is_seeded(&self) -> bool {
        self.clusters().is_some() && !self.is_tree()
    }

    /// Returns true if trees cut its columns.
    pub(crate) fn is_tree(&self) -> bool {
        matches!(self, Self::Tree(_) | Self::Labels { within: Within::Tree(_), .. })
    }

    /// Returns true if its regions come from k-means on all rows that the memory holds.
    pub(crate) fn is_clustered(&self) -> bool {
        self.clusters().is_some() && !self.fits_targets()
    }

    /// Number of regions to which cells are joined.
    pub(crate) fn joined(&self) -> Option<usize> {
        if let Self::Lattice(k) = self { Some(*k) } else { None }
    }
}

impl Within {
    /// One cluster is the whole.
    fn kmeans(k: usize) -> Self {
        if k > 1 { Self::KMeans(k) } else { Self::Whole }
    }
}

impl FromStr for Specification {
    type Err = SpecificationError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let fail = |problem: &str| SpecificationError { text: text.to_owned(), problem: problem.to_owned() };
        let clusters = |value: &str| {
            value
                .parse()
                .map_err(|_| fail("the number of clusters must be a whole number"))
                .and_then(|k| check_clusters(text, k))
        };
        let deep = |value: &str| match value.parse() {
            Ok(depth) if (1..=DEEPEST).contains(&depth) => Ok(depth),
            _ => Err(fail("the depth of a tree must be between 1 and 10")),
        };
        let deviations = |value: &str| match value.parse::<f64>() {
            Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
            _ => Err(fail("the size must be a positive number of standard deviations")),
        };
        match text.split_once(':') {
            None if text == "null" => Ok(Self::Null),
            None if text == "average" => Ok(Self::Average),
            Some(("zscore", radius)) => Ok(Self::ZScore(deviations(radius)?)),
            Some(("zbox", half)) => Ok(Self::ZBox(deviations(half)?)),
            Some(("kmeans", k)) => Ok(Self::KMeans(clusters(k)?)),
            Some(("refined", k)) => Ok(Self::Refined(clusters(k)?)),
            Some(("lattice", k)) => Ok(Self::Lattice(clusters(k)?)),
            Some(("tree", depth)) => Ok(Self::Tree(deep(depth)?)),
            Some(("labels", rest)) => {
                let (column, within) = match rest.rsplit_once('+').map(|(column, kind)| (column, kind.split_once(':')))
                {
                    Some((column, Some(("kmeans", k)))) => (column, Within::kmeans(clusters(k)?)),
                    Some((column, Some(("refined", k)))) => (column, Within::Refined(clusters(k)?)),
                    Some((column, Some(("tree", depth)))) => (column, Within::Tree(deep(depth)?)),
                    Some((_, Some(("lattice", _)))) => {
                        return Err(fail("after labels only kmeans, refined or tree can follow"));
                    }
                    _ => (rest, Within::Whole),
                };
                if column.is_empty() {
                    return Err(fail("name the column of the labels"));
                }
                Ok(Self::Labels { column: column.to_owned(), within })
            }
            _ => Err(fail("unknown kind")),
        }
    }
}

/// A number, or all of a range `2..20`; nothing where the text is neither.
fn counts(item: &str, text: &str) -> Result<Vec<usize>, SpecificationError> {
    let Some((from, to)) = text.split_once("..") else { return Ok(text.parse().into_iter().collect()) };
    match (from.parse::<usize>(), to.parse::<usize>()) {
        (Ok(from), Ok(to)) if from <= to && to - from < MOST_OF_A_RANGE => Ok((from..=to).collect()),
        (Ok(_), Ok(_)) => Err(SpecificationError {
            text: item.to_owned(),
            problem: format!("a range must go up and have at most {MOST_OF_A_RANGE} numbers"),
        }),
        _ => Ok(Vec::new()),
    }
}

/// Cuts of a tree one after another, at most: 1,024 regions.
const DEEPEST: usize = 10;

/// Partitions that one range may stand for.
const MOST_OF_A_RANGE: usize = 200;

fn check_clusters(text: &str, k: usize) -> Result<usize, SpecificationError> {
    if (1..=10_000).contains(&k) {
        Ok(k)
    } else {
        Err(SpecificationError {
            text: text.to_owned(),
            problem: "the number of clusters must be between 1 and 10000".into(),
        })
    }
}

impl fmt::Display for Specification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null => f.write_str("null"),
            Self::Average => f.write_str("average"),
            Self::ZScore(radius) => write!(f, "zscore:{radius}"),
            Self::ZBox(half) => write!(f, "zbox:{half}"),
            Self::KMeans(k) => write!(f, "kmeans:{k}"),
            Self::Refined(k) => write!(f, "refined:{k}"),
            Self::Lattice(k) => write!(f, "lattice:{k}"),
            Self::Tree(depth) => write!(f, "tree:{depth}"),
            Self::Labels { column, within: Within::Whole } => write!(f, "labels:{column}"),
            Self::Labels { column, within: Within::KMeans(k) } => write!(f, "labels:{column}+kmeans:{k}"),
            Self::Labels { column, within: Within::Refined(k) } => write!(f, "labels:{column}+refined:{k}"),
            Self::Labels { column, within: Within::Tree(depth) } => write!(f, "labels:{column}+tree:{depth}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_read_and_printed() {
        let text = "null,average,zscore:1.5,zbox:2,kmeans:2,5,10,labels:terrain,labels:a.b+kmeans:3,4";
        let list = Specification::parse_list(text).unwrap();
        assert_eq!(list.len(), 10);
        assert_eq!(list[3], Specification::ZBox(2.0));
        assert_eq!(list[6], Specification::KMeans(10));
        assert_eq!(list[9], Specification::Labels { column: "a.b".into(), within: Within::KMeans(4) });
        let within = Specification::parse_list("labels:a+refined:2,3,lattice:4").unwrap();
        assert_eq!(within[1], Specification::Labels { column: "a".into(), within: Within::Refined(3) });
        assert_eq!(within[2], Specification::Lattice(4));
        assert_eq!(within[1].to_string().parse::<Specification>().unwrap(), within[1]);
        for item in list {
            assert_eq!(item.to_string().parse::<Specification>().unwrap(), item);
        }
    }

    #[test]
    fn ranges_have_both_ends() {
        let list = Specification::parse_list(
            "kmeans:2..4,refined:2..3,7,9..10,labels:a..b+kmeans:2..3,lattice:2..3,tree:1..2,4",
        )
        .unwrap();
        let names: Vec<String> = list.iter().map(ToString::to_string).collect();
        assert_eq!(
            names.join(" "),
            "kmeans:2 kmeans:3 kmeans:4 refined:2 refined:3 refined:7 refined:9 refined:10 labels:a..b+kmeans:2 labels:a..b+kmeans:3 lattice:2 lattice:3 tree:1 tree:2 tree:4"
        );
        assert_eq!(Specification::parse_list("refined:5..5").unwrap(), [Specification::Refined(5)]);
    }

    #[test]
    fn nonsense_is_refused() {
        for text in [
            "",
            "kmeans",
            "kmeans:0",
            "kmeans:-1",
            "kmeans:x",
            "zscore:-1",
            "zscore:nan",
            "zbox",
            "zbox:0",
            "labels:",
            "3",
            "voronoi:3",
            "kmeans:99999999",
            "refined",
            "refined:0",
            "refined:5..2",
            "refined:0..2",
            "lattice",
            "lattice:0",
            "labels:a+lattice:3",
            "tree",
            "tree:0",
            "tree:11",
            "tree:2,12",
            "labels:a+tree:0",
            "kmeans:1..9999",
            "average:2..3",
            "2..3",
            "average,2..3",
        ] {
            assert!(Specification::parse_list(text).is_err(), "{text}");
        }
    }
}
