//! The C code of what passes from region to region, and of the points that tell where a region's distribution stands.

/// Crossing of borders, where regions follow from the state.
pub(super) const JOIN: &str = "/* Keeps where the points stand. */
static void @P@_remember_(@P@_state *f)
{
    for (size_t r = 0; r < @R@; ++r) {
        for (size_t i = 0; i < @POINTS@; ++i) {
            f->before[r][i] = f->place[r][i];
        }
    }
}

/* Joins in every region what stayed there and what came over its border. */
static void @P@_join_(@P@_state *f)
{
    @T@ share[@R@];
    @T@ w[@R@];
    bool inside[@POINTS@];
    bool stayed = true;
    for (size_t to = 0; to < @R@; ++to) {
        @T@ all = #0.0#;
        for (size_t from = 0; from < @R@; ++from) {
            size_t began = 0;
            size_t count = 0;
            share[from] = #0.0#;
            if (!(f->w[from] > #0.0#)) {
                continue;
            }
            for (size_t i = 0; i < @POINTS@; ++i) {
                began += (f->before[from][i] == (int16_t)from) ? 1U : 0U;
            }
            for (size_t i = 0; i < @POINTS@; ++i) {
                inside[i] = @P@_went_(f->before[from], f->place[from], began > 0, (int16_t)from, (int16_t)to, i);
                count += inside[i] ? 1U : 0U;
            }
            if (count == 0) {
                continue;
            }
            stayed = stayed && from == to;
            share[from] = f->w[from] * ((@T@)count / (@T@)((began > 0) ? began : @POINTS@));
            all += share[from];
            if (from == to) {
                for (size_t i = 0; i < @POINTS@; ++i) {
                    inside[i] = false;
                }
            }
            @P@_part_(f->m[from], f->p[from], inside, f->part_m[from], f->part_p[from]);
        }
        w[to] = all;
        if (all > #0.0#) {
            for (size_t from = 0; from < @R@; ++from) {
                share[from] /= all;
            }
            @P@_mixture_(share, f->part_m, f->part_p, f->next_m[to], f->next_p[to]);
        }
    }
    if (!stayed) {
        @P@_take_over_(f, w);
    }
}

";

/// One region follows another by probabilities of their own.
pub(super) const SWITCH: &str = "@T@ w[@R@];
@T@ share[@R@];
for (size_t to = 0; to < @R@; ++to) {
    @T@ all = #0.0#;
    for (size_t from = 0; from < @R@; ++from) {
        share[from] = f->w[from] * @P@_transition[from * @R@ + to];
        all += share[from];
    }
    for (size_t from = 0; from < @R@; ++from) {
        share[from] /= all;
    }
    w[to] = all;
    @P@_mixture_(share, f->m, f->p, f->next_m[to], f->next_p[to]);
}
@P@_take_over_(f, w);";

pub(super) const MASS: &str = "/* The share of the points that stand in a region; half of one where none does. */
static @T@ @P@_mass_(const int16_t place[@POINTS@], int16_t region)
{
    size_t count = 0;
    for (size_t i = 0; i < @POINTS@; ++i) {
        count += (place[i] == region) ? 1U : 0U;
    }
    return ((count > 0) ? (@T@)count : #0.5#) / (@T@)@POINTS@;
}

";

pub(super) const PARTS: &str = "bool inside[@POINTS@];
for (size_t r = 0; r < @R@; ++r) {
    if (f->w[r] > #0.0#) {
        for (size_t i = 0; i < @POINTS@; ++i) {
            inside[i] = f->place[r][i] == (int16_t)r;
        }
        @P@_part_(f->m[r], f->p[r], inside, f->next_m[r], f->next_p[r]);
    }
}";

pub(super) const WHOLE: &str = "for (size_t r = 0; r < @R@; ++r) {
    for (size_t i = 0; i < @A@; ++i) {
        f->next_m[r][i] = f->m[r][i];
    }
    for (size_t i = 0; i < @AA@; ++i) {
        f->next_p[r][i] = f->p[r][i];
    }
}";

/// Probabilities at the start, by the points of the one distribution that there is.
pub(super) const SHARES: &str = "@T@ all = #0.0#;
@T@ own[@R@];
for (size_t r = 0; r < @R@; ++r) {
    own[r] = #0.0#;
    for (size_t i = 0; i < @POINTS@; ++i) {
        own[r] += (f->place[0][i] == (int16_t)r) ? #1.0# : #0.0#;
    }
    all += own[r];
}
if (all > #0.0#) {
    for (size_t r = 0; r < @R@; ++r) {
        f->w[r] = own[r] / all;
    }
}";
