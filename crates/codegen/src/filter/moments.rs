//! Moments of distributions in C: the factor of a covariance, points, mixtures.

use super::sizes::Filter;
use crate::{print::Syntax, writer::Writer};

/// A region is dropped below this probability.
const LEAST: f64 = 1e-9;

impl Filter<'_> {
    /// Lower Cholesky factor of a covariance; a direction without spread has a column of zeros.
    pub(super) fn factor(&self, w: &mut Writer) {
        let Self { all, n, nn, p, square, t, zero, .. } = self;
        let sqrt = self.c.library("sqrt");
        w.comment("Lower Cholesky factor of a covariance; a direction without spread has a column of zeros.");
        w.function(&format!("static void {p}_factor_(const {t} p[{square}], {t} l[{nn}])"), |w| {
            w.each("i", nn, |w| {
                writeln!(w, "l[i] = {zero};");
            });
            w.each("j", n, |w| {
                w.range("i", "j", n, |w| {
                    writeln!(w, "{t} v = p[i * {all} + j];");
                    w.each("k", "j", |w| {
                        writeln!(w, "v -= l[i * {n} + k] * l[j * {n} + k];");
                    });
                    w.branches(&[
                        ("if (i == j)", &|w| {
                            writeln!(w, "l[j * {n} + j] = (v > {zero}) ? {sqrt}(v) : {zero};");
                        }),
                        (&format!("else if (l[j * {n} + j] > {zero})"), &|w| {
                            writeln!(w, "l[i * {n} + j] = v / l[j * {n} + j];");
                        }),
                    ]);
                });
            });
        });
    }

    /// A point of a distribution, as an offset from its mean.
    pub(super) fn offset(&self, w: &mut Writer) {
        let Self { n, nn, p, t, zero, .. } = self;
        w.comment("A point of a distribution, as an offset from its mean.");
        w.function(&format!("static void {p}_offset_(const {t} l[{nn}], size_t point, {t} offset[{n}])"), |w| {
            w.each("s", n, |w| {
                writeln!(w, "offset[s] = {zero};");
                w.through("k", "s", |w| {
                    writeln!(w, "offset[s] += l[s * {n} + k] * {p}_points[point * {n} + k];");
                });
            });
        });
    }

    /// The normal distribution with the moments of a mixture of the parts whose weight is not 0.
    pub(super) fn mixture(&self, w: &mut Writer) {
        let Self { all, p, r, square, t, zero, .. } = self;
        w.comment("The normal distribution with the moments of a mixture of the parts whose weight is not 0.");
        let head = format!(
            "static void {p}_mixture_(const {t} w[{r}], {t} pm[{r}][{all}], {t} pp[{r}][{square}], \
             {t} m[{all}], {t} p[{square}])"
        );
        w.function(&head, |w| {
            writeln!(w, "size_t count = 0;");
            writeln!(w, "size_t first = 0;");
            w.block(format_args!("for (size_t r = {r}; r-- > 0;)"), |w| {
                w.block(format_args!("if (w[r] > {zero})"), |w| {
                    writeln!(w, "first = r;");
                    writeln!(w, "++count;");
                });
            });
            w.each("i", all, |w| {
                writeln!(w, "m[i] = pm[first][i];");
            });
            w.each("i", square, |w| {
                writeln!(w, "p[i] = pp[first][i];");
            });
            w.block(format_args!("if (count < 2)"), |w| {
                writeln!(w, "return;");
            });
            w.each("i", all, |w| {
                w.range("r", "first + 1", r, |w| {
                    w.block(format_args!("if (w[r] > {zero})"), |w| {
                        writeln!(w, "{t} d = pm[r][i] - pm[first][i];");
                        self.wrap(w, "i", "d");
                        writeln!(w, "m[i] += w[r] * d;");
                    });
                });
                self.wrap(w, "i", "m[i]");
            });
            w.each("i", square, |w| {
                writeln!(w, "p[i] = {zero};");
            });
            w.range("r", "first", r, |w| {
                w.block(format_args!("if (w[r] > {zero})"), |w| {
                    writeln!(w, "{t} off[{all}];");
                    w.each("i", all, |w| {
                        writeln!(w, "{t} d = pm[r][i] - m[i];");
                        self.wrap(w, "i", "d");
                        writeln!(w, "off[i] = d;");
                    });
                    w.each("i", all, |w| {
                        w.through("j", "i", |w| {
                            writeln!(w, "p[i * {all} + j] += w[r] * (pp[r][i * {all} + j] + off[i] * off[j]);");
                        });
                    });
                });
            });
            w.each("i", all, |w| {
                w.each("j", "i", |w| {
                    writeln!(w, "p[j * {all} + i] = p[i * {all} + j];");
                });
            });
        });
    }

    /// Drops regions that are hardly probable.
    pub(super) fn likely(&self, w: &mut Writer) {
        let Self { p, r, t, zero, .. } = self;
        let least = self.c.number(LEAST);
        w.comment("Drops regions that are hardly probable.");
        w.function(&format!("static void {p}_likely_({t} w[{r}])"), |w| {
            writeln!(w, "{t} all = {zero};");
            w.each("r", r, |w| {
                w.block(format_args!("if (w[r] < {least})"), |w| {
                    writeln!(w, "w[r] = {zero};");
                });
                writeln!(w, "all += w[r];");
            });
            w.each("r", r, |w| {
                writeln!(w, "w[r] /= all;");
            });
        });
    }

    /// Joins in every region the parts that `share` (from x to) gives it.
    pub(super) fn take_over(&self, w: &mut Writer) {
        let Self { all, p, r, square, t, zero, .. } = self;
        w.comment("Joins in every region the parts that `share` (from x to) gives it.");
        w.function(&format!("static void {p}_take_over_({p}_state *f, const {t} w[{r}])"), |w| {
            w.each("r", r, |w| {
                writeln!(w, "f->w[r] = w[r];");
            });
            writeln!(w, "{p}_likely_(f->w);");
            w.each("r", r, |w| {
                w.block(format_args!("if (f->w[r] > {zero})"), |w| {
                    w.each("i", all, |w| {
                        writeln!(w, "f->m[r][i] = f->next_m[r][i];");
                    });
                    w.each("i", square, |w| {
                        writeln!(w, "f->p[r][i] = f->next_p[r][i];");
                    });
                    if self.by_state {
                        self.place_region(w);
                    }
                });
            });
        });
    }
}
