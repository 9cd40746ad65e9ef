//! Statistics as bytes, bit for bit.

use fleetfoot_data::{EpisodeId, packed_row};

use crate::{Fold, Gram, Key, Keyed, MergeError, Sum};

/// Version of the bytes.
const FORMAT: u64 = 1;
/// Bytes of the head: version, shape (the columns), number of statistics.
const HEAD: usize = 24;
/// Bytes of a key.
const KEY: usize = 16 + 4 + 2 + 2 * 4 + 2 + 4;
/// Word that encodes "no fold".
const NO_FOLD: u32 = u32::MAX;

/// Bytes that are no statistics.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the statistics cannot be read, as their bytes are damaged or of another version: {0}")]
pub struct StatsBytesError(&'static str);

impl<S: Sum> Keyed<S> {
    /// The keys and statistics as bytes, the same for the same bits; the plan's hash is not among them.
    ///
    /// # Panics
    /// When the statistics are not all of the same columns.
    pub fn to_bytes(&self) -> Vec<u8> {
        let d = self.dimension().unwrap_or(0);
        let mut bytes = Vec::with_capacity(HEAD + self.len() * record::<S>(d).unwrap_or(0));
        for word in [FORMAT, d as u64, self.len() as u64] {
            bytes.extend(word.to_le_bytes());
        }
        for (key, sum) in self.iter() {
            assert_eq!(sum.shape(), d, "statistics of the same columns");
            bytes.extend(key.episode.0.to_le_bytes());
            bytes.extend(key.chunk.to_le_bytes());
            bytes.extend(key.fold.held_out.to_le_bytes());
            for purged in key.fold.purged {
                bytes.extend(purged.map_or(NO_FOLD, u32::from).to_le_bytes());
            }
            bytes.extend(key.partition.to_le_bytes());
            bytes.extend(key.region.to_le_bytes());
            sum.write(&mut |word| bytes.extend(word));
        }
        bytes
    }

    /// Reads what [`Self::to_bytes`] wrote; `plan` is the plan's hash. What is allocated is bounded by the number of bytes.
    ///
    /// # Errors
    /// Bytes of another version or length, and keys that are not in ascending order.
    pub fn from_bytes(plan: impl Into<String>, bytes: &[u8]) -> Result<Self, StatsBytesError> {
        let mut reader = Reader(bytes);
        let short = StatsBytesError("they end too early");
        let [format, d, count] = reader.words().ok_or(short.clone())?;
        if format != FORMAT {
            return Err(StatsBytesError("their version is not 1"));
        }
        let d = usize::try_from(d).map_err(|_| short.clone())?;
        let length = record::<S>(d).and_then(|record| record.checked_mul(usize::try_from(count).ok()?));
        if length != Some(reader.0.len()) {
            return Err(StatsBytesError("their length does not fit the counts"));
        }
        let mut stats = Self::new(plan);
        let mut last = None;
        for _ in 0..count {
            let (key, sum) = reader.record::<S>(d).ok_or(short.clone())?;
            if last.is_some_and(|last| last >= key) {
                return Err(StatsBytesError("their keys are not in ascending order"));
            }
            last = Some(key);
            stats.insert(key, sum).map_err(|_: MergeError| StatsBytesError("a key is there twice"))?;
        }
        Ok(stats)
    }
}

/// Bytes of one statistic of a shape, its key among them.
fn record<S: Sum>(shape: usize) -> Option<usize> {
    S::words(shape)?.checked_mul(8)?.checked_add(KEY)
}

impl Sum for Gram {
    fn merge(&mut self, other: &Self) {
        Gram::merge(self, other);
    }

    fn shape(&self) -> usize {
        self.dimension()
    }

    fn words(shape: usize) -> Option<usize> {
        shape.checked_add(1)?.checked_mul(shape)?.checked_div(2)?.checked_add(shape)?.checked_add(2)
    }

    fn write(&self, put: &mut dyn FnMut([u8; 8])) {
        put(self.rows.to_le_bytes());
        put(self.weight.to_le_bytes());
        self.mean.iter().chain(&self.scatter).for_each(|value| put(value.to_le_bytes()));
    }

    fn read(shape: usize, take: &mut dyn FnMut() -> Option<[u8; 8]>) -> Option<Self> {
        let rows = u64::from_le_bytes(take()?);
        let mut number = || take().map(f64::from_le_bytes);
        let weight = number()?;
        let mean = (0..shape).map(|_| number()).collect::<Option<_>>()?;
        let scatter = (0..packed_row(shape)).map(|_| number()).collect::<Option<_>>()?;
        Some(Gram { rows, weight, mean, scatter })
    }
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*bytes)
    }

    fn words<const N: usize>(&mut self) -> Option<[u64; N]> {
        let mut words = [0; N];
        for word in &mut words {
            *word = u64::from_le_bytes(self.take()?);
        }
        Some(words)
    }

    fn record<S: Sum>(&mut self, shape: usize) -> Option<(Key, S)> {
        let episode = EpisodeId(u128::from_le_bytes(self.take()?));
        let chunk = u32::from_le_bytes(self.take()?);
        let mut fold = Fold { held_out: u16::from_le_bytes(self.take()?), purged: [None; 2] };
        for purged in &mut fold.purged {
            *purged = match u32::from_le_bytes(self.take()?) {
                NO_FOLD => None,
                fold => Some(u16::try_from(fold).ok()?),
            };
        }
        let partition = u16::from_le_bytes(self.take()?);
        let region = u32::from_le_bytes(self.take()?);
        let sum = S::read(shape, &mut || self.take())?;
        Some((Key { episode, chunk, fold, partition, region }, sum))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Stats;

    fn keys() -> impl Strategy<Value = Key> {
        let fold = (any::<u16>(), any::<[Option<u16>; 2]>()).prop_map(|(held_out, purged)| Fold { held_out, purged });
        (any::<u128>(), any::<u32>(), fold, any::<u16>(), any::<u32>()).prop_map(
            |(episode, chunk, fold, partition, region)| Key {
                episode: EpisodeId(episode),
                chunk,
                fold,
                partition,
                region,
            },
        )
    }

    fn statistics() -> impl Strategy<Value = Stats> {
        (0_usize..5).prop_flat_map(|d| {
            let numbers = |count| prop::collection::vec(any::<f64>(), count);
            let gram = (any::<u64>(), any::<f64>(), numbers(d), numbers(packed_row(d)))
                .prop_map(|(rows, weight, mean, scatter)| Gram { rows, weight, mean, scatter });
            prop::collection::btree_map(keys(), gram, 0..6).prop_map(|grams| {
                let mut stats = Stats::new("plan");
                grams.into_iter().for_each(|(key, gram)| stats.insert(key, gram).unwrap());
                stats
            })
        })
    }

    proptest! {
        #[test]
        fn bytes_come_back_bit_for_bit(stats in statistics()) {
            let bytes = stats.to_bytes();
            let again = Stats::from_bytes("plan", &bytes).unwrap();
            prop_assert_eq!(again.to_bytes(), bytes);
            prop_assert_eq!(again.iter().map(|(key, _)| *key).collect::<Vec<_>>(), stats.iter().map(|(key, _)| *key).collect::<Vec<_>>());
        }

        #[test]
        fn truncated_or_trailing_bytes_are_refused(stats in statistics(), cut in any::<prop::sample::Index>()) {
            let mut bytes = stats.to_bytes();
            prop_assert!(Stats::from_bytes("plan", &bytes[..cut.index(bytes.len())]).is_err());
            bytes.push(0);
            prop_assert!(Stats::from_bytes("plan", &bytes).is_err());
        }

        #[test]
        fn any_bytes_are_read_or_refused(head in any::<[u64; 3]>(), tail in prop::collection::vec(any::<u8>(), 0..300)) {
            let mut bytes: Vec<u8> = head.iter().flat_map(|word| word.to_le_bytes()).collect();
            bytes[..8].copy_from_slice(&FORMAT.to_le_bytes());
            bytes.extend(tail);
            prop_assert!(Stats::from_bytes("plan", &bytes).is_err() || head[2] == 0);
        }
    }

    #[test]
    fn keys_out_of_order_are_refused() {
        let mut stats = Stats::new("plan");
        for chunk in 0..2 {
            let key = Key { episode: EpisodeId(7), chunk, fold: Fold::default(), partition: 0, region: 0 };
            stats.insert(key, Gram::new(1)).unwrap();
        }
        let bytes = stats.to_bytes();
        let length = (bytes.len() - HEAD) / 2;
        let swapped = [&bytes[..HEAD], &bytes[HEAD + length..], &bytes[HEAD..HEAD + length]].concat();
        let error = Stats::from_bytes("plan", &swapped).unwrap_err().to_string();
        assert!(error.contains("ascending"), "{error}");
    }
}
