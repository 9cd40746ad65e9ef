//! Partitions as users write them: `null`, `average`, `zscore:1.5`, `kmeans:10`, `kmeans:2,5,10`, `labels:terrain`, `labels:terrain+kmeans:5`.

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
    "partition `{text}`: {problem}; write null, average, zscore:1.5, kmeans:10, kmeans:2,5,10, labels:COLUMN or labels:COLUMN+kmeans:5"
)]
pub struct SpecificationError {
    text: String,
    problem: String,
}

impl Specification {
    /// Parses a list such as `average,zscore:1.5,kmeans:2,5,10`: bare numbers continue the k-means before them.
    pub fn parse_list(text: &str) -> Result<Vec<Self>, SpecificationError> {
        let mut list: Vec<Self> = Vec::new();
        for item in text.split(',').map(str::trim) {
            let more = match (item.parse::<usize>(), list.last()) {
                (Ok(k), Some(Self::KMeans(_))) => Some(Self::KMeans(check_clusters(item, k)?)),
                (Ok(k), Some(Self::Labels { column, k: 2.. })) => {
                    Some(Self::Labels { column: column.clone(), k: check_clusters(item, k)? })
                }
                _ => None,
            };
            list.push(match more {
                Some(specification) => specification,
                None => item.parse()?,
            });
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

    /// Whether rows have to be clustered.
    pub fn clusters(&self) -> Option<usize> {
        match self {
            Self::KMeans(k) | Self::Labels { k: k @ 2.., .. } => Some(*k),
            _ => None,
        }
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
        ] {
            assert!(Specification::parse_list(text).is_err(), "{text}");
        }
    }
}
