//! Crossing of borders in C, if regions follow from the state: the points of a distribution give its regions.

use super::sizes::Filter;
use crate::{print::Syntax, writer::Writer};

impl Filter<'_> {
    /// The region of every point of a distribution; -1 where none holds.
    pub(super) fn place(&self, w: &mut Writer) {
        let Self { all, n, nn, p, points, square, t, .. } = self;
        let u = self.u_parameter();
        let given = self.given("u");
        w.comment("The region of every point of a distribution; -1 where none holds.");
        let head =
            format!("static void {p}_place_(const {t} m[{all}], const {t} p[{square}]{u}, int16_t place[{points}])");
        w.function(&head, |w| {
            writeln!(w, "{t} l[{nn}];");
            writeln!(w, "{t} x[{n}];");
            writeln!(w, "{p}_factor_(p, l);");
            w.each("i", points, |w| {
                writeln!(w, "{p}_offset_(l, i, x);");
                w.each("s", n, |w| {
                    writeln!(w, "x[s] = m[s] + x[s];");
                    self.wrap(w, "s", "x[s]");
                });
                writeln!(w, "const int region = {p}_region_(x{given});");
                writeln!(w, "place[i] = (region >= 0) ? (int16_t)region : (int16_t)-1;");
            });
        });
    }

    /// The regions of the points of region `r`.
    pub(super) fn place_region(&self, w: &mut Writer) {
        let Self { p, .. } = self;
        let given = self.given("f->u");
        writeln!(w, "{p}_place_(f->m[r], f->p[r]{given}, f->place[r]);");
    }

    /// The regions of the points of every region.
    pub(super) fn place_regions(&self, w: &mut Writer) {
        let Self { r, zero, .. } = self;
        w.each("r", r, |w| {
            w.block(format_args!("if (f->w[r] > {zero})"), |w| {
                self.place_region(w);
            });
        });
    }

    /// Writes the test that a point left its region for another one; if no point was in the region, all count.
    pub(super) fn went(&self, w: &mut Writer) {
        let Self { p, points, .. } = self;
        w.comment(
            "Whether a point that stood in a region now stands in another one; where none stood there, \
             all count.",
        );
        let head = format!(
            "static bool {p}_went_(const int16_t before[{points}], const int16_t after[{points}], bool any, \
             int16_t from, int16_t to, size_t i)"
        );
        w.function(&head, |w| {
            writeln!(w, "const int16_t now = (after[i] >= 0) ? after[i] : from;");
            writeln!(w, "return (!any || before[i] == from) && now == to;");
        });
    }

    /// The normal distribution of those points that are marked.
    pub(super) fn part(&self, w: &mut Writer) {
        let Self { all, n, nn, p, points, square, t, zero, .. } = self;
        w.comment("The normal distribution of those points that are marked.");
        let head = format!(
            "static void {p}_part_(const {t} m[{all}], const {t} p[{square}], const bool inside[{points}], \
             {t} pm[{all}], {t} pp[{square}])"
        );
        w.function(&head, |w| {
            writeln!(w, "size_t count = 0;");
            w.each("i", points, |w| {
                writeln!(w, "count += inside[i] ? 1U : 0U;");
            });
            w.each("i", all, |w| {
                writeln!(w, "pm[i] = m[i];");
            });
            w.each("i", square, |w| {
                writeln!(w, "pp[i] = p[i];");
            });
            w.block(format_args!("if (count == 0 || count == {points})"), |w| {
                writeln!(w, "return;");
            });
            writeln!(w, "{t} l[{nn}];");
            if self.behind > 0 {
                writeln!(w, "{t} first[{nn}];");
            }
            writeln!(w, "{t} offset[{n}];");
            writeln!(w, "{t} centre[{n}] = {{ {zero} }};");
            writeln!(w, "{p}_factor_(p, l);");
            w.each("i", points, |w| {
                w.block(format_args!("if (inside[i])"), |w| {
                    writeln!(w, "{p}_offset_(l, i, offset);");
                    w.each("s", n, |w| {
                        writeln!(w, "centre[s] += offset[s];");
                    });
                });
            });
            w.each("s", n, |w| {
                writeln!(w, "centre[s] /= ({t})count;");
            });
            self.spread_of_part(w);
            if self.behind > 0 {
                self.regressed(w);
            }
        });
    }

    /// The mean and the covariance of the states over the points of a part.
    fn spread_of_part(&self, w: &mut Writer) {
        let Self { all, n, nn, p, points, t, .. } = self;
        let two = self.c.number(2.0);
        // With residuals behind the states, the covariance of the states stands in a matrix of its own size.
        let target = if self.behind > 0 { "first" } else { "pp" };
        if self.behind > 0 {
            w.each("a", n, |w| {
                w.each("b", n, |w| {
                    writeln!(w, "first[a * {n} + b] = {two} * p[a * {all} + b];");
                });
            });
        } else {
            w.each("i", nn, |w| {
                writeln!(w, "pp[i] *= {two};");
            });
        }
        w.each("i", points, |w| {
            w.block(format_args!("if (inside[i])"), |w| {
                writeln!(w, "{p}_offset_(l, i, offset);");
                w.each("a", n, |w| {
                    w.through("b", "a", |w| {
                        writeln!(w, "{target}[a * {n} + b] += (offset[a] - centre[a]) * (offset[b] - centre[b]);");
                    });
                });
            });
        });
        w.each("a", n, |w| {
            w.through("b", "a", |w| {
                writeln!(w, "{target}[a * {n} + b] /= ({t})count + {two};");
                writeln!(w, "{target}[b * {n} + a] = {target}[a * {n} + b];");
            });
            writeln!(w, "pm[a] = m[a] + centre[a];");
            self.wrap(w, "a", "pm[a]");
        });
    }

    /// Keeps the regions of the points.
    pub(super) fn remember(&self, w: &mut Writer) {
        let Self { p, points, r, .. } = self;
        w.comment("Keeps the regions of the points.");
        w.function(&format!("static void {p}_remember_({p}_state *f)"), |w| {
            w.each("r", r, |w| {
                w.each("i", points, |w| {
                    writeln!(w, "f->before[r][i] = f->place[r][i];");
                });
            });
        });
    }

    /// Joins in every region the part that stayed there and the parts that came over its border.
    pub(super) fn join(&self, w: &mut Writer) {
        let Self { p, points, r, t, zero, .. } = self;
        w.comment("Joins in every region the points that stayed and those that crossed its border.");
        w.function(&format!("static void {p}_join_({p}_state *f)"), |w| {
            writeln!(w, "{t} share[{r}];");
            writeln!(w, "{t} w[{r}];");
            writeln!(w, "bool inside[{points}];");
            writeln!(w, "bool stayed = true;");
            w.each("to", r, |w| {
                writeln!(w, "{t} all = {zero};");
                w.each("from", r, |w| {
                    writeln!(w, "size_t began = 0;");
                    writeln!(w, "size_t count = 0;");
                    writeln!(w, "share[from] = {zero};");
                    w.block(format_args!("if (!(f->w[from] > {zero}))"), |w| {
                        writeln!(w, "continue;");
                    });
                    w.each("i", points, |w| {
                        writeln!(w, "began += (f->before[from][i] == (int16_t)from) ? 1U : 0U;");
                    });
                    w.each("i", points, |w| {
                        writeln!(
                            w,
                            "inside[i] = {p}_went_(f->before[from], f->place[from], began > 0, \
                             (int16_t)from, (int16_t)to, i);"
                        );
                        writeln!(w, "count += inside[i] ? 1U : 0U;");
                    });
                    w.block(format_args!("if (count == 0)"), |w| {
                        writeln!(w, "continue;");
                    });
                    writeln!(w, "stayed = stayed && from == to;");
                    writeln!(w, "share[from] = f->w[from] * (({t})count / ({t})((began > 0) ? began : {points}));");
                    writeln!(w, "all += share[from];");
                    w.block(format_args!("if (from == to)"), |w| {
                        w.each("i", points, |w| {
                            writeln!(w, "inside[i] = false;");
                        });
                    });
                    writeln!(w, "{p}_part_(f->m[from], f->p[from], inside, f->part_m[from], f->part_p[from]);");
                });
                writeln!(w, "w[to] = all;");
                w.block(format_args!("if (all > {zero})"), |w| {
                    w.each("from", r, |w| {
                        writeln!(w, "share[from] /= all;");
                    });
                    writeln!(w, "{p}_mixture_(share, f->part_m, f->part_p, f->next_m[to], f->next_p[to]);");
                });
            });
            w.block(format_args!("if (!stayed)"), |w| {
                writeln!(w, "{p}_take_over_(f, w);");
            });
        });
    }

    /// The share of the points in a region; half a point if there is none.
    pub(super) fn mass(&self, w: &mut Writer) {
        let Self { p, points, t, .. } = self;
        let one_half = self.c.number(0.5);
        w.comment("The share of the points in a region; half a point if there is none.");
        w.function(&format!("static {t} {p}_mass_(const int16_t place[{points}], int16_t region)"), |w| {
            writeln!(w, "size_t count = 0;");
            w.each("i", points, |w| {
                writeln!(w, "count += (place[i] == region) ? 1U : 0U;");
            });
            writeln!(w, "return ((count > 0) ? ({t})count : {one_half}) / ({t}){points};");
        });
    }

    /// Of every region: the part of it that stands within its borders.
    pub(super) fn parts(&self, w: &mut Writer) {
        let Self { p, points, r, zero, .. } = self;
        writeln!(w, "bool inside[{points}];");
        w.each("r", r, |w| {
            w.block(format_args!("if (f->w[r] > {zero})"), |w| {
                w.each("i", points, |w| {
                    writeln!(w, "inside[i] = f->place[r][i] == (int16_t)r;");
                });
                writeln!(w, "{p}_part_(f->m[r], f->p[r], inside, f->next_m[r], f->next_p[r]);");
            });
        });
    }

    /// Probabilities at the start, by the points of the one distribution that there is.
    pub(super) fn shares(&self, w: &mut Writer) {
        let Self { points, r, t, zero, .. } = self;
        let one = self.c.number(1.0);
        writeln!(w, "{t} all = {zero};");
        writeln!(w, "{t} own[{r}];");
        w.each("r", r, |w| {
            writeln!(w, "own[r] = {zero};");
            w.each("i", points, |w| {
                writeln!(w, "own[r] += (f->place[0][i] == (int16_t)r) ? {one} : {zero};");
            });
            writeln!(w, "all += own[r];");
        });
        w.block(format_args!("if (all > {zero})"), |w| {
            w.each("r", r, |w| {
                writeln!(w, "f->w[r] = own[r] / all;");
            });
        });
    }
}
