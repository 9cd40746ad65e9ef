//! The study's tables, as Markdown.

use super::{
    comparison::{Case, DATA, Study, THRESHOLD, thresholds},
    fit::{PROBABILITY, REPLICATES},
    judge::Verdict,
};

/// One table: a row a system, a cell a kind of data, with pysindy's answer at its own threshold before that of the ensemble.
pub(crate) fn systems(study: &Study) {
    let heads: Vec<&str> = DATA.iter().map(|(name, _)| *name).collect();
    println!("| system | {} |\n|---|{}", heads.join(" | "), "---|".repeat(heads.len()));
    for row in study.cases.chunks(DATA.len()) {
        let cell = |case: &Case| match &case.peer {
            Some(peer) if same_print(peer.fixed, case.ensemble) => case.ensemble.to_string(),
            Some(peer) => format!("{}; {}", peer.fixed, case.ensemble),
            None => case.ensemble.to_string(),
        };
        let cells: Vec<String> = row.iter().map(cell).collect();
        println!("| {} | {} |", row[0].system, cells.join(" | "));
    }
    println!(
        "\nNorm of the coefficients' error over that of the coefficients; ahead of it +terms that are not true, -terms that were missed. Where there are two, \
         pysindy (STLSQ at {THRESHOLD}) stands before fleetfoot ({REPLICATES} replicates of it, terms of {:.0} % of them).",
        100.0 * PROBABILITY
    );
}

fn same_print(a: Verdict, b: Verdict) -> bool {
    (a.missing, a.extra) == (b.missing, b.extra) && (a.to_string() == b.to_string() || a.error.max(b.error) < 1e-12)
}

/// What both programs find with the same method.
pub(crate) fn agreement(studies: &[Study]) {
    let Some(first) = studies.first() else { return };
    match &first.peer {
        Err(reason) => println!("\npysindy was not run: {reason} (FLEETFOOT_PYTHON names a Python that has it)"),
        Ok(version) => {
            let beside = || studies.iter().flat_map(|study| &study.cases).filter_map(|case| case.peer.as_ref());
            let (same, all) = (beside().map(|peer| peer.same).sum::<usize>(), beside().count() * thresholds().len());
            let apart = beside().map(|peer| peer.apart).fold(0.0, f64::max);
            println!(
                "\nSTLSQ of pysindy {version} and of fleetfoot: the same terms in {same} of {all} fits ({} thresholds); there, coefficients differ by at most \
                 {apart:.0e} of the largest.",
                thresholds().len()
            );
        }
    }
}

/// Structures that are right and terms that are wrong, over all studies.
pub(crate) fn totals(studies: &[Study]) {
    println!(
        "\n| right structures, wrong terms | of | pysindy | pysindy, best threshold | fleetfoot | fleetfoot, cross-validated threshold | fleetfoot, ensemble |"
    );
    println!("|---|---|---|---|---|---|---|");
    for (data, _) in DATA {
        let cases: Vec<&Case> =
            studies.iter().flat_map(|study| &study.cases).filter(|case| case.data == data).collect();
        let total = |of: &dyn Fn(&Case) -> Option<Verdict>| {
            let all: Option<Vec<Verdict>> = cases.iter().map(|case| of(case)).collect();
            all.map_or_else(String::new, |all| {
                let wrong: usize = all.iter().map(Verdict::wrong).sum();
                format!("{}, {wrong}", all.iter().filter(|verdict| verdict.is_right()).count())
            })
        };
        println!(
            "| {data} | {} | {} | {} | {} | {} | {} |",
            cases.len(),
            total(&|case| case.peer.as_ref().map(|peer| peer.fixed)),
            total(&|case| case.peer.as_ref().map(|peer| peer.best)),
            total(&|case| Some(case.fixed)),
            total(&|case| Some(case.chosen)),
            total(&|case| Some(case.ensemble))
        );
    }
}
