//! Process noise in C that is correlated from row to row: the whitened residuals of earlier rows stand behind the
//! states.

use super::sizes::Filter;
use crate::writer::Writer;

impl Filter<'_> {
    /// The residuals behind the states of a part: they follow the states by regression.
    pub(super) fn regressed(&self, w: &mut Writer) {
        let Self { all, behind, n, t, zero, .. } = self;
        w.each("a", n, |w| {
            w.each("b", n, |w| {
                writeln!(w, "pp[a * {all} + b] = first[a * {n} + b];");
            });
        });
        writeln!(w, "{t} gain[{behind}][{n}];");
        w.each("h", behind, |w| {
            w.each("i", n, |w| {
                writeln!(w, "{t} v = p[({n} + h) * {all} + i];");
                w.each("k", "i", |w| {
                    writeln!(w, "v -= l[i * {n} + k] * gain[h][k];");
                });
                writeln!(w, "gain[h][i] = (l[i * {n} + i] > {zero}) ? v / l[i * {n} + i] : {zero};");
            });
            w.block(format_args!("for (size_t i = {n}; i-- > 0;)"), |w| {
                writeln!(w, "{t} v = gain[h][i];");
                w.range("k", "i + 1", n, |w| {
                    writeln!(w, "v -= l[k * {n} + i] * gain[h][k];");
                });
                writeln!(w, "gain[h][i] = (l[i * {n} + i] > {zero}) ? v / l[i * {n} + i] : {zero};");
            });
        });
        self.following_residuals(w);
    }

    /// The moments of these residuals.
    fn following_residuals(&self, w: &mut Writer) {
        let Self { all, behind, n, t, zero, .. } = self;
        w.each("h", behind, |w| {
            w.each("k", n, |w| {
                writeln!(w, "pm[{n} + h] += gain[h][k] * centre[k];");
            });
            w.each("j", n, |w| {
                writeln!(w, "{t} both = {zero};");
                writeln!(w, "{t} change = {zero};");
                w.each("k", n, |w| {
                    writeln!(w, "both += gain[h][k] * first[k * {n} + j];");
                    writeln!(w, "change += gain[h][k] * (first[k * {n} + j] - p[k * {all} + j]);");
                });
                writeln!(w, "pp[({n} + h) * {all} + j] = both;");
                writeln!(w, "pp[j * {all} + {n} + h] = both;");
                writeln!(w, "offset[j] = change;");
            });
            w.through("o", "h", |w| {
                writeln!(w, "{t} v = p[({n} + h) * {all} + {n} + o];");
                w.each("j", n, |w| {
                    writeln!(w, "v += offset[j] * gain[o][j];");
                });
                writeln!(w, "pp[({n} + h) * {all} + {n} + o] = v;");
                writeln!(w, "pp[({n} + o) * {all} + {n} + h] = v;");
            });
        });
    }

    /// The residuals one row on, then the states.
    pub(super) fn coloured_predict(&self, w: &mut Writer) {
        let Self { all, n, nn, p, q, r, square, t, zero, .. } = self;
        w.comment("Of every region: its step, and the residuals that its noise hangs on.");
        w.function(&format!("static void {p}_predict_({p}_state *f)"), |w| {
            w.each("r", r, |w| {
                w.block(format_args!("if (!(f->w[r] > {zero}))"), |w| {
                    writeln!(w, "continue;");
                });
                writeln!(w, "const {t} *a = &{p}_a[r * {nn}];");
                writeln!(w, "const {t} *q = &{p}_q[r * {nn}];");
                writeln!(w, "const {t} *s = &{p}_s[r * ({n} * {q})];");
                writeln!(w, "{t} *p = f->p[r];");
                writeln!(w, "{t} m[{all}];");
                writeln!(w, "{t} half[{square}];");
                writeln!(w, "{t} moved[{square}];");
                self.residuals(w);
                self.spread_of_residuals(w);
                self.states(w);
                w.each("i", all, |w| {
                    writeln!(w, "f->m[r][i] = m[i];");
                    self.wrap(w, "i", "f->m[r][i]");
                    w.each("j", all, |w| {
                        writeln!(w, "p[i * {all} + j] = moved[i * {all} + j];");
                    });
                });
                self.spread_of_states(w);
            });
        });
    }

    /// Predicts the residuals of the next row, and their covariance with the states and residuals of this row.
    fn residuals(&self, w: &mut Writer) {
        let Self { all, behind, n, p, q, zero, .. } = self;
        w.each("i", all, |w| {
            writeln!(w, "m[i] = (i < {n} + {q}) ? {zero} : f->m[r][i - {q}];");
            w.each("j", all, |w| {
                writeln!(w, "half[i * {all} + j] = (i < {n} + {q}) ? p[i * {all} + j] : p[(i - {q}) * {all} + j];");
                writeln!(w, "moved[i * {all} + j] = p[i * {all} + j];");
            });
        });
        w.each("i", q, |w| {
            w.each("j", all, |w| {
                writeln!(w, "half[({n} + i) * {all} + j] = {zero};");
            });
            w.each("k", behind, |w| {
                writeln!(w, "m[{n} + i] += {p}_phi[i * {behind} + k] * f->m[r][{n} + k];");
                w.each("j", all, |w| {
                    writeln!(
                        w,
                        "half[({n} + i) * {all} + j] += {p}_phi[i * {behind} + k] * \
                         p[({n} + k) * {all} + j];"
                    );
                });
            });
        });
    }

    /// The covariance of the residuals of the next row.
    fn spread_of_residuals(&self, w: &mut Writer) {
        let Self { all, behind, n, p, q, t, zero, .. } = self;
        w.range("i", n, all, |w| {
            w.through("j", "i", |w| {
                writeln!(w, "{t} v = {zero};");
                w.branches(&[
                    (&format!("if (j < {n})"), &|w| {
                        writeln!(w, "v = half[i * {all} + j];");
                    }),
                    (&format!("else if (j < {n} + {q})"), &|w| {
                        writeln!(w, "v = (i < {n} + {q}) ? {p}_new[(i - {n}) * {q} + j - {n}] : {zero};");
                        w.each("k", behind, |w| {
                            writeln!(w, "v += half[i * {all} + {n} + k] * {p}_phi[(j - {n}) * {behind} + k];");
                        });
                    }),
                    ("else", &|w| {
                        writeln!(w, "v = half[i * {all} + j - {q}];");
                    }),
                ]);
                writeln!(w, "moved[i * {all} + j] = v;");
                writeln!(w, "moved[j * {all} + i] = v;");
            });
        });
    }

    /// Predicts the states of the next row, and their covariance with the states and residuals of this row.
    fn states(&self, w: &mut Writer) {
        let Self { all, n, p, q, t, zero, .. } = self;
        w.each("i", n, |w| {
            writeln!(w, "{t} v = {p}_c[r * {n} + i];");
            w.each("j", n, |w| {
                writeln!(w, "v += a[i * {n} + j] * f->m[r][j];");
            });
            self.driven(w);
            w.each("t", q, |w| {
                writeln!(w, "v += s[i * {q} + t] * m[{n} + t];");
            });
            writeln!(w, "m[i] = v;");
            w.each("j", all, |w| {
                writeln!(w, "half[i * {all} + j] = {zero};");
            });
            w.each("k", n, |w| {
                w.each("j", all, |w| {
                    writeln!(w, "half[i * {all} + j] += a[i * {n} + k] * moved[k * {all} + j];");
                });
            });
            w.each("t", q, |w| {
                w.each("j", all, |w| {
                    writeln!(w, "half[i * {all} + j] += s[i * {q} + t] * moved[({n} + t) * {all} + j];");
                });
            });
        });
    }

    /// The covariance of the states of the next row.
    fn spread_of_states(&self, w: &mut Writer) {
        let Self { all, n, q, t, .. } = self;
        w.each("i", n, |w| {
            w.through("j", "i", |w| {
                writeln!(w, "{t} v = q[i * {n} + j];");
                w.each("k", n, |w| {
                    writeln!(w, "v += half[i * {all} + k] * a[j * {n} + k];");
                });
                w.each("t", q, |w| {
                    writeln!(w, "v += half[i * {all} + {n} + t] * s[j * {q} + t];");
                });
                writeln!(w, "p[i * {all} + j] = v;");
                writeln!(w, "p[j * {all} + i] = v;");
            });
            w.range("j", n, all, |w| {
                writeln!(w, "p[i * {all} + j] = half[i * {all} + j];");
                writeln!(w, "p[j * {all} + i] = half[i * {all} + j];");
            });
        });
    }

    /// The estimate of the states alone.
    pub(super) fn estimate_of_states(&self, w: &mut Writer) {
        let Self { all, n, p, square, t, .. } = self;
        writeln!(w, "{t} m[{all}];");
        writeln!(w, "{t} p[{square}];");
        writeln!(w, "{p}_mixture_(f->w, f->next_m, f->next_p, m, p);");
        w.each("i", n, |w| {
            writeln!(w, "f->x[i] = m[i];");
            w.each("j", n, |w| {
                writeln!(w, "f->cov[i * {n} + j] = p[i * {all} + j];");
            });
        });
    }

    /// The mean and covariance that each region starts from: those of the states, and the stationary ones of the residuals.
    pub(super) fn coloured_begin(&self, w: &mut Writer) {
        let Self { all, behind, n, p, t, zero, .. } = self;
        w.each("i", all, |w| {
            writeln!(w, "f->m[r][i] = (i < {n}) ? f->x[i] : {zero};");
            w.each("j", all, |w| {
                writeln!(w, "{t} v = {zero};");
                w.block(format_args!("if (i < {n} && j < {n})"), |w| {
                    writeln!(w, "v = f->cov[i * {n} + j];");
                });
                w.block(format_args!("if (i >= {n} && j >= {n})"), |w| {
                    writeln!(w, "v = {p}_lasting[(i - {n}) * {behind} + j - {n}];");
                });
                writeln!(w, "f->p[r][i * {all} + j] = v;");
            });
        });
    }
}
