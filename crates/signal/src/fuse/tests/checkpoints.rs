//! Fusions that are stopped and go on.

use fleetfoot_data::with_threads;

use super::{Recording, known};
use crate::fuse::{BodyRun, Checkpoint, FuseOptions, Fused, fuse, fuse_from};

/// Keeps all that it is given.
#[derive(Default)]
struct Kept {
    first: Option<Vec<u8>>,
    all: Vec<Vec<u8>>,
}

impl Checkpoint for Kept {
    fn load(&mut self) -> Option<Vec<u8>> {
        self.first.clone()
    }

    fn save(&mut self, state: &[u8]) {
        self.all.push(state.to_vec());
    }
}

/// Killed after any round, a fusion comes to the same answer, on any number of threads.
#[test]
fn a_killed_fusion_goes_on_to_the_same_bits() {
    let mut recordings = [Recording::new(0.9, 30), Recording::new(0.7, 31)];
    // Gross errors, so that what counts changes on the way.
    (20..80).step_by(17).for_each(|row| recordings[0].positions[row][0] += 0.05);
    let runs = recordings.each_ref().map(Recording::run);
    let options = FuseOptions { fit_noise: true, ..known() };
    let mut kept = Kept::default();
    let whole = fuse_from(&runs, &options, &mut kept).unwrap();
    let rounds = kept.all.len();
    assert!(rounds > 3, "{rounds}");
    let go_on = |at: usize, threads| {
        let mut from = Kept { first: Some(kept.all[at].clone()), ..Kept::default() };
        let fused: Fused = with_threads(threads, || fuse_from(&runs, &options, &mut from).unwrap());
        // Finished work is not repeated.
        assert_eq!(from.all.len() + at + 1, rounds);
        fused
    };
    // The states lie on each other's way: what one comes to, those between come to.
    for (at, threads) in [(0, 2), (rounds / 2, 1), (rounds - 1, 7)] {
        assert_eq!(go_on(at, threads), whole, "{at} {threads}");
    }
}

/// A checkpoint of another problem, or a damaged one, is ignored.
#[test]
fn checkpoints_of_another_problem_are_ignored() {
    let recordings = [Recording::new(1.0, 32), Recording::new(1.0, 33)];
    let of = |at: usize| -> [BodyRun<'_>; 1] { [recordings[at].run()] };
    let mut kept = Kept::default();
    let resumed = fuse_from(&of(0), &known(), &mut kept).unwrap();
    let state = kept.all[0].clone();
    let from = |state: Vec<u8>, at: usize| {
        let mut kept = Kept { first: Some(state), ..Kept::default() };
        (fuse_from(&of(at), &known(), &mut kept).unwrap(), kept.all.len())
    };
    let (other, _) = from(state.clone(), 1);
    assert_eq!(other, fuse(&of(1), &known()).unwrap());
    for damaged in [Vec::new(), state[..state.len() - 3].to_vec(), state[..64].to_vec(), {
        let mut flipped = state.clone();
        flipped[state.len() / 2] ^= 1;
        flipped
    }] {
        let (fused, saves) = from(damaged, 0);
        assert!(fused == resumed && saves == kept.all.len());
    }
}
