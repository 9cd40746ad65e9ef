//! Partitions as users write them: `null`, `average`, `zscore:1.5`, `kmeans:10`, `kmeans:2,5,10`, `refined:5`, `refined:2..20`, `labels:terrain`,
//! `labels:terrain+kmeans:5`.

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
    /// Voronoi cells of k-means centroids.
    KMeans(usize),
    /// Regions that fit the dynamics, between linear separators.
    Refined(usize),
    /// One region per value of a column; within each, k-means when `k > 1`.
    Labels {
        /// The column.
        column: String,
        /// Clusters within each label.
        k: usize,
    },
}

/// Why a partition could not be understood.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "partition `{text}`: {problem}; write null, average, zscore:1.5, kmeans:10, kmeans:2,5,10, refined:5, refined:2..20, labels:COLUMN or labels:COLUMN+kmeans:5"
)]
pub struct SpecificationError {
    text: String,
    problem: String,
}

impl Specification {
    /// Parses a list such as `average,zscore:1.5,kmeans:2,5,10,refined:2..20`: bare numbers continue what is before them, and a range has both its ends.
    ///
    /// # Errors
    /// What is no partition, with those that are.
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
                    for count in counts {
                        list.push(last.with_clusters(check_clusters(item, count)?));
                    }
                }
                _ => list.push(item.parse()?),
            }
        }
        Ok(list)
    }

    /// The same kind with another number of clusters.
    fn with_clusters(&self, k: usize) -> Self {
        match self {
            Self::KMeans(_) => Self::KMeans(k),
            Self::Refined(_) => Self::Refined(k),
            Self::Labels { column, .. } => Self::Labels { column: column.clone(), k },
            other => other.clone(),
        }
    }

    /// The label column that it needs.
    pub fn label(&self) -> Option<&str> {
        match self {
            Self::Labels { column, .. } => Some(column),
            _ => None,
        }
    }

    /// How many regions are searched for (within each label), where that depends on the rows.
    pub fn clusters(&self) -> Option<usize> {
        match self {
            Self::KMeans(k) | Self::Refined(k) | Self::Labels { k: k @ 2.., .. } => Some(*k),
            _ => None,
        }
    }

    /// Whether its regions follow from the targets too, and not from where rows lie alone.
    pub fn is_refined(&self) -> bool {
        matches!(self, Self::Refined(_))
    }

    /// Whether k-means on all rows that the memory holds makes its regions.
    pub(crate) fn is_clustered(&self) -> bool {
        self.clusters().is_some() && !self.is_refined()
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
        match text.split_once(':') {
            None if text == "null" => Ok(Self::Null),
            None if text == "average" => Ok(Self::Average),
            Some(("zscore", radius)) => match radius.parse::<f64>() {
                Ok(radius) if radius > 0.0 && radius.is_finite() => Ok(Self::ZScore(radius)),
                _ => Err(fail("the radius must be a positive number of standard deviations")),
            },
            Some(("kmeans", k)) => Ok(Self::KMeans(clusters(k)?)),
            Some(("refined", k)) => Ok(Self::Refined(clusters(k)?)),
            Some(("labels", rest)) => {
                let (column, k) = match rest.rsplit_once("+kmeans:") {
                    Some((column, k)) => (column, clusters(k)?),
                    None => (rest, 1),
                };
                if column.is_empty() {
                    return Err(fail("name the column of the labels"));
                }
                Ok(Self::Labels { column: column.to_owned(), k })
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
            problem: format!("a range goes up, over {MOST_OF_A_RANGE} numbers at most"),
        }),
        _ => Ok(Vec::new()),
    }
}

/// Partitions that one range may stand for.
const MOST_OF_A_RANGE: usize = 200;

fn check_clusters(text: &str, k: usize) -> Result<usize, SpecificationError> {
    if (1..=10_000).contains(&k) {
        Ok(k)
    } else {
        Err(SpecificationError { text: text.to_owned(), problem: "between 1 and 10000 clusters".into() })
    }
}

impl fmt::Display for Specification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null => f.write_str("null"),
            Self::Average => f.write_str("average"),
            Self::ZScore(radius) => write!(f, "zscore:{radius}"),
            Self::KMeans(k) => write!(f, "kmeans:{k}"),
            Self::Refined(k) => write!(f, "refined:{k}"),
            Self::Labels { column, k: 0 | 1 } => write!(f, "labels:{column}"),
            Self::Labels { column, k } => write!(f, "labels:{column}+kmeans:{k}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_read_and_printed() {
        let text = "null,average,zscore:1.5,kmeans:2,5,10,labels:terrain,labels:a.b+kmeans:3,4";
        let list = Specification::parse_list(text).unwrap();
        assert_eq!(list.len(), 9);
        assert_eq!(list[5], Specification::KMeans(10));
        assert_eq!(list[8], Specification::Labels { column: "a.b".into(), k: 4 });
        for item in list {
            assert_eq!(item.to_string().parse::<Specification>().unwrap(), item);
        }
    }

    #[test]
    fn ranges_have_both_ends() {
        let list = Specification::parse_list("kmeans:2..4,refined:2..3,7,9..10,labels:a..b+kmeans:2..3").unwrap();
        let names: Vec<String> = list.iter().map(ToString::to_string).collect();
        assert_eq!(
            names.join(" "),
            "kmeans:2 kmeans:3 kmeans:4 refined:2 refined:3 refined:7 refined:9 refined:10 labels:a..b+kmeans:2 labels:a..b+kmeans:3"
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
            "labels:",
            "3",
            "voronoi:3",
            "kmeans:99999999",
            "refined",
            "refined:0",
            "refined:5..2",
            "refined:0..2",
            "kmeans:1..9999",
            "average:2..3",
            "2..3",
            "average,2..3",
        ] {
            assert!(Specification::parse_list(text).is_err(), "{text}");
        }
    }
}
