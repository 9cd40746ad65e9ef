//! Statistics joined, parted, compacted.

use super::*;

#[test]
fn partial_scans_merge_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2, 3], 2);
    let all = scanned(&files, None);
    let plan = all.without_rows();
    let parts: Vec<StatisticFile> = files.chunks(2).map(|files| scanned(files, Some(plan.clone()))).collect();
    for order in [[0, 1, 2], [2, 0, 1], [1, 2, 0], [2, 1, 0]] {
        let mut whole = parts[order[0]].clone();
        for &part in &order[1..] {
            whole.merge("one", parts[part].clone(), "other").unwrap();
        }
        assert_eq!(whole, all);
        assert_eq!(bytes(&whole), bytes(&all), "{order:?}");
    }
}

#[test]
fn appending_gives_the_scan_of_all_with_the_first_plan() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2, 3], 2);
    let first = scanned(&files[..3], None);
    let (appended, report) = scan(&recipe(), &options(), Some(first.clone()), &files, &Silent).unwrap();
    assert_eq!((report.files, report.episodes, report.skipped.len()), (3, 3, 3));
    assert_eq!(bytes(&appended), bytes(&scanned(&files, Some(first.without_rows()))));
    // Everything is there: nothing is read, nothing changes.
    let (again, report) = scan(&recipe(), &options(), Some(appended.clone()), &files, &Silent).unwrap();
    assert_eq!((report.files, report.skipped.len()), (0, 6));
    assert_eq!(again, appended);
}

#[test]
fn the_same_log_never_counts_twice() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1], 2);
    let first = scanned(&files, None);
    // The same bytes under another name, and the same rows in another file.
    let (copy, rewritten) = (folder.path().join("copy.csv"), folder.path().join("rewritten.csv"));
    fs::copy(&files[0], &copy).unwrap();
    fs::write(&rewritten, fs::read_to_string(&files[1]).unwrap().replace('\n', "\r\n")).unwrap();
    let (file, report) = scan(&recipe(), &options(), Some(first.clone()), &[copy.clone(), rewritten], &Silent).unwrap();
    assert_eq!(file.scanned, first.scanned);
    assert!(report.skipped[0].contains("copy.csv: the same content as"), "{:?}", report.skipped);
    assert!(report.skipped[1].contains("the same rows as"), "{:?}", report.skipped);
    assert_eq!(scanned(&[files[0].clone(), copy], None).episodes.len(), 1);
    let mut merged = first.clone();
    let message = merged.merge("a.stats", first.clone(), "b.stats").unwrap_err().to_string();
    assert!(
        message.contains("a.stats") && message.contains("b.stats") && message.contains("flight_0.csv"),
        "{message}"
    );
    assert_eq!(merged, first, "unchanged");
}

#[test]
fn other_plans_are_refused_with_the_difference() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2], 1);
    let first = scanned(&files[..1], None);
    let message = |recipe: &str, options: &ScanOptions| {
        let recipe = Recipe::parse(recipe, "test").unwrap();
        scan(&recipe, options, Some(first.clone()), &files[1..], &Silent).unwrap_err().to_string()
    };
    let wider = message(&RECIPE.replace("degree = 2", "degree = 3"), &options());
    assert!(wider.contains("  + T : x^3") && !wider.contains("  - "), "{wider}");
    let column = message(&RECIPE.replace("v = \"v\"", "v = \"2*v\""), &options());
    assert!(column.contains("  - column v = v") && column.contains("  + column v = 2*v"), "{column}");
    let chunks = message(RECIPE, &ScanOptions { chunk_rows: NonZeroUsize::new(50), ..options() });
    assert!(chunks.contains("  - chunk_rows = 40") && chunks.contains("  + chunk_rows = 50"), "{chunks}");
    // Also when there is nothing new to scan.
    let other = Recipe::parse(&RECIPE.replace("degree = 2", "degree = 3"), "test").unwrap();
    let known = scan(&other, &options(), Some(first.clone()), &files[..1], &Silent).unwrap_err().to_string();
    assert!(known.contains("  + T : x^3"), "{known}");
    // The same recipe, its own pilot.
    let mut joined = first.clone();
    let message = joined.merge("a.stats", scanned(&files[1..], None), "b.stats").unwrap_err().to_string();
    assert!(message.contains("other coordinates") && message.contains("--plan"), "{message}");
    assert!(first.resolve(&Recipe::parse(&RECIPE.replace("T - D", "T + D"), "test").unwrap()).is_err());
    // Settings that do not change the sums may differ.
    let stronger = RECIPE.replace("degree = 2", "degree = 2, penalty = 0.5");
    assert_eq!(first.resolve(&Recipe::parse(&stronger, "test").unwrap()).unwrap().penalties[1], 0.5);
}

#[test]
fn dropping_logs_equals_a_scan_of_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2, 3], 2);
    let all = scanned(&files, None);
    let plan = all.without_rows();
    let id = all.episodes.iter().find(|episode| episode.name.contains("/1/flight_0")).unwrap().id.to_string();
    let path = files[0].to_string_lossy().into_owned();
    let name = |path: &str| Unwanted::File(path.to_owned());
    for unwanted in [Unwanted::Episode(path.clone()), Unwanted::Episode(id[..10].to_owned()), name(&path)] {
        let mut left = all.clone();
        assert_eq!(left.drop_episodes(&[unwanted]).unwrap(), [path.as_str()]);
        assert_eq!(bytes(&left), bytes(&scanned(&files[1..], Some(plan.clone()))));
    }
    let mut left = all.clone();
    let label = |value: &str| Unwanted::Label("aircraft".into(), value.into());
    assert_eq!(left.drop_episodes(&[label("1"), label("3")]).unwrap().len(), 4);
    assert_eq!(bytes(&left), bytes(&scanned(&files[2..4], Some(plan))));
    // A dropped log can be appended again.
    let again = scanned(&files, Some(left.clone()));
    assert_eq!(bytes(&again), bytes(&all));

    let refused = |file: &mut StatisticFile, one| file.drop_episodes(&[one]).unwrap_err().to_string();
    let message = refused(&mut left, label("7"));
    assert!(message.contains("--where aircraft=7 matches no episode; the statistic has aircraft=2"), "{message}");
    assert!(refused(&mut left, Unwanted::Episode("x".into())).contains("flight_1.csv"));
    assert!(refused(&mut left, label("2")).contains("all 2 episodes"));
}

#[test]
fn compaction_keeps_the_totals_and_the_episodes() {
    let folder = tempfile::tempdir().unwrap();
    let whole = scanned(&fleet(folder.path(), &[1, 2], 2), None);
    let mut compact = whole.clone();
    compact.compact();
    assert_eq!(compact.chunks(), 4);
    assert!(bytes(&compact).len() < bytes(&whole).len());
    for (small, large) in compact.scanned.tasks.iter().zip(&whole.scanned.tasks) {
        for episode in &whole.episodes {
            let of = |stats: &fleetfoot_stats::Stats| stats.total(|key| key.episode == episode.id).unwrap();
            assert_eq!(of(&small.stats), of(&large.stats), "the sum within an episode is in key order either way");
        }
    }
    let again = StatisticFile::from_bytes(&bytes(&compact), Path::new("run.stats")).unwrap().0;
    assert_eq!(again, compact);
}

#[test]
fn parts_appended_in_order_are_the_scan_of_all() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = fleet(folder.path(), &[1, 2], 2);
    // A log without a complete row, and the same bytes under another name.
    let (hollow, copy) = (folder.path().join("hollow.csv"), folder.path().join("copy.csv"));
    let rows: String = (0..50).map(|row| format!("{},{row},nan,1,1\n", 0.01 * f64::from(row))).collect();
    fs::write(&hollow, format!("t,x,v,a,b\n{rows}")).unwrap();
    fs::copy(&files[0], &copy).unwrap();
    files.extend([hollow.clone(), copy]);
    let options = ScanOptions { keys: Vec::new(), ..options() };
    let all = scan(&recipe(), &options, None, &files, &Silent).unwrap();
    let (plan, _) = freeze(&recipe(), &options, &files, &Silent).unwrap();
    assert_eq!(bytes(&plan), bytes(&all.0.without_rows()));
    let part = |file: &PathBuf| scan_part(&plan, &options, &[file], &Silent).unwrap().0;
    let parts: Vec<StatisticFile> = files.iter().map(part).collect();
    // From left to right, and as a tree.
    let mut whole = plan.clone();
    let skipped: Vec<String> = parts.iter().flat_map(|part| whole.append(part.clone()).unwrap()).collect();
    assert_eq!(bytes(&whole), bytes(&all.0));
    assert_eq!(skipped, all.1.skipped);
    let joined = |parts: &[StatisticFile]| {
        let mut whole = parts[0].clone();
        parts[1..].iter().for_each(|part| _ = whole.append(part.clone()).unwrap());
        whole
    };
    let tree: Vec<StatisticFile> = parts.chunks(2).map(joined).collect();
    assert_eq!(bytes(&joined(&tree)), bytes(&all.0));
    assert!(scan(&recipe(), &options, Some(plan.clone()), &[hollow], &Silent).is_err(), "alone it is an error");
    // The same rows in another file are refused, here as in one scan.
    let rewritten = folder.path().join("rewritten.csv");
    fs::write(&rewritten, fs::read_to_string(&files[1]).unwrap().replace('\n', "\r\n")).unwrap();
    assert!(whole.append(part(&rewritten)).unwrap_err().to_string().contains("hold the same log"));
    assert_eq!(whole, all.0, "unchanged");
    files.push(rewritten);
    assert!(scan(&recipe(), &options, None, &files, &Silent).is_err());
}

#[test]
fn keeping_logs_equals_a_scan_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2], 2);
    let all = scanned(&files, None);
    let mut some = all.clone();
    let dropped = some.keep_episodes(|episode| episode.labels["aircraft"] == "2").unwrap();
    assert_eq!(dropped.len(), 2);
    assert_eq!(bytes(&some), bytes(&scanned(&files[2..], Some(all.without_rows()))));
    let mut none = all.clone();
    assert!(none.keep_episodes(|_| false).unwrap_err().to_string().contains("all 4 episodes"));
    assert!(none.keep_episodes(|_| true).unwrap().is_empty());
    assert_eq!(none, all);
}

#[test]
fn sparse_models_of_statistics_equal_logs() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2, 3], 2);
    let recipe = recipe();
    let model = |logs: fleetfoot_dataset::Logs| {
        let fitted = crate::fit_all::<crate::Sparse>(&recipe, &crate::FitRequest::default(), logs, &Silent).unwrap();
        fitted[0].model.to_json()
    };
    let options = ScanOptions::default();
    let all = scan(&recipe, &options, None, &files, &Silent).unwrap().0;
    let plan = all.without_rows();
    let part = |files: &[PathBuf]| scan(&recipe, &options, Some(plan.clone()), files, &Silent).unwrap().0;
    let mut halves = part(&files[3..]);
    halves.merge("one", part(&files[..3]), "other").unwrap();
    let mut apart = plan.clone();
    for file in &files {
        apart.merge("all", part(std::slice::from_ref(file)), "one").unwrap();
    }
    let wanted = model((&files).into());
    for statistic in [all, halves, apart] {
        let model = model(fleetfoot_dataset::Logs::of_statistic(std::sync::Arc::new(statistic)));
        assert!(model == wanted, "{model}\n{wanted}");
    }
}
