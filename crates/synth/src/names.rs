//! Names of generated runs.

use super::world::robots;

/// The name of a run's file.
pub(super) fn run_name(robot: &str, run: u64, runs: u64, extension: &str) -> String {
    let digits = runs.saturating_sub(1).max(1).ilog10() as usize + 1;
    format!("{robot}_{run:0width$}.{extension}", width = digits.max(2))
}

/// Returns true if a file has the name of a generated run.
pub(super) fn is_run(name: &str) -> bool {
    let Some((stem, "mcap" | "parquet")) = name.rsplit_once('.') else { return false };
    let Some((robot, run)) = stem.rsplit_once('_') else { return false };
    run.len() >= 2 && run.bytes().all(|byte| byte.is_ascii_digit()) && robots().contains(&robot)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_sort_by_their_numbers() {
        assert_eq!(run_name("hexapod", 3, 16, "mcap"), "hexapod_03.mcap");
        assert_eq!(run_name("hexapod", 99, 100, "mcap"), "hexapod_99.mcap");
        assert_eq!(run_name("hexapod", 7, 101, "parquet"), "hexapod_007.parquet");
        assert_eq!(run_name("hexapod", 0, 1, "mcap"), "hexapod_00.mcap");
    }
}
