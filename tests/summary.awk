# Passes on what `cargo test` prints, sums up its results in a last line, and ends with its exit status.
!/^exit status / { print; fflush() }
/^ *Running / { binary = $0; sub(/^ *Running /, "", binary); sub(/ \(.*/, "", binary) }
/^ *Doc-tests / { binary = $0; sub(/^ */, "", binary) }
/^test result: / {
    for (i = 3; i < NF; i++) {
        if ($(i + 1) ~ /^passed/) passed += $i
        if ($(i + 1) ~ /^ignored/) ignored += $i
        if ($(i + 1) ~ /^failed/ && $i > 0) { failed += $i; where = where (where ? ", " : "") binary " (" $i ")" }
    }
}
/^exit status / { status = $3 }
END {
    printf "%d passed, %d failed, %d skipped\n", passed, failed, ignored
    if (failed) print "failures in: " where
    else if (status) print "cargo ended with status " status ": see the errors above"
    exit status
}
