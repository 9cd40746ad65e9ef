//! The inputs of the fuzz target, through its very function.

use proptest::prelude::*;

use super::*;

#[path = "../../../../../fuzz/fuzz_targets/body/stats.rs"]
mod body;

/// Statistics of small logs, and the inputs that fuzzing was found to need, in the order of their names.
fn corpus() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1], 2);
    let mut inputs = vec![bytes(&scanned(&files[..1], None)), bytes(&scanned(&files, None))];
    inputs.extend(equations::small(folder.path()));
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/stats");
    // The folder is there once something was found.
    let mut files: Vec<PathBuf> = fs::read_dir(kept).into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    inputs.extend(files.iter().map(|file| fs::read(file).unwrap()));
    inputs
}

#[test]
fn the_corpus_is_read() {
    let accepted = corpus().iter().filter(|data| body::run(data)).count();
    assert!(accepted >= 4, "statistics of this version are read");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn changes_of_the_corpus_do_no_harm(which in any::<prop::sample::Index>(), at in any::<prop::sample::Index>(), bytes in prop::collection::vec(any::<u8>(), 1..12)) {
        thread_local!(static CORPUS: Vec<Vec<u8>> = corpus());
        CORPUS.with(|corpus| {
            let mut data = which.get(corpus).clone();
            let from = at.index(data.len());
            let to = (from + bytes.len()).min(data.len());
            data[from..to].copy_from_slice(&bytes[..to - from]);
            body::run(&data);
        });
    }
}
