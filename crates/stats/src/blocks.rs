//! Blocks of rows: neighbouring chunks together, for methods that need nearly independent parts.

use fleetfoot_data::EpisodeId;

/// Blocks of a statistic, about, and rows beyond which a block need not be longer.
const BLOCKS: u64 = 40;
const ROWS: u64 = 256;

/// The block of every chunk (episode and rows, in key order): neighbouring chunks of an episode are one block until it has a fortieth of all rows, or 256.
///
/// Chunks may be as short as folds need them. Clusters of standard errors and units of a bootstrap must not: short ones are correlated with their neighbours.
pub fn blocks(chunks: impl IntoIterator<Item = (EpisodeId, u64)>) -> Vec<usize> {
    let chunks: Vec<(EpisodeId, u64)> = chunks.into_iter().collect();
    let wanted = (chunks.iter().map(|(_, rows)| rows).sum::<u64>() / BLOCKS).clamp(1, ROWS);
    let mut blocks: Vec<usize> = Vec::with_capacity(chunks.len());
    let (mut open, mut next) = (None::<(EpisodeId, u64)>, 0);
    // The rows of the episode that are still to come: a rest that makes no block joins the last one.
    let mut rest: Vec<u64> = vec![0; chunks.len()];
    for k in (1..chunks.len()).rev() {
        rest[k - 1] = if chunks[k].0 == chunks[k - 1].0 { rest[k] + chunks[k].1 } else { 0 };
    }
    for (k, &(episode, rows)) in chunks.iter().enumerate() {
        let same = open.is_some_and(|(open_episode, filled)| {
            open_episode == episode && (filled < wanted || rest[k] + rows < wanted)
        });
        if !same {
            open = Some((episode, 0));
            next += 1;
        }
        if let Some((_, filled)) = &mut open {
            *filled += rows;
        }
        blocks.push(next - 1);
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_short_chunks_are_joined() {
        let chunks = |episodes: &[(usize, u64)]| -> Vec<(EpisodeId, u64)> {
            let chunks_of_episode =
                |(e, &(count, rows)): (usize, &(usize, u64))| vec![(EpisodeId(e as u128), rows); count];
            episodes.iter().enumerate().flat_map(chunks_of_episode).collect()
        };
        // 25 rows a block: five chunks; what is left of an episode joins its last block.
        let block_of_chunk = blocks(chunks(&[(102, 5), (102, 5)]));
        let sizes: Vec<usize> =
            (0..=block_of_chunk[203]).map(|b| block_of_chunk.iter().filter(|&&block| block == b).count()).collect();
        assert_eq!(sizes.len(), 40);
        assert!(sizes.iter().all(|&size| (5..=7).contains(&size)), "{sizes:?}");
        assert_ne!(block_of_chunk[101], block_of_chunk[102]);
        assert_eq!(blocks(chunks(&[(4, 50), (3, 50)])), [0, 1, 2, 3, 4, 5, 6]);
        let long = blocks(chunks(&[(200, 5000)]));
        assert_eq!(long, (0..200).collect::<Vec<_>>());
        assert!(blocks([]).is_empty());
    }
}
