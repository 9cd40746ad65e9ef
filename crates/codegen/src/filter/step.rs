//! A step in C: prediction, measurements, estimate.

use super::sizes::Filter;
use crate::{print::Syntax, writer::Writer};

impl Filter<'_> {
    /// Of every region: its step.
    pub(super) fn predict(&self, w: &mut Writer) {
        match self.behind {
            0 => self.white_predict(w),
            _ => self.coloured_predict(w),
        }
    }

    /// A step with white noise.
    fn white_predict(&self, w: &mut Writer) {
        let Self { n, nn, p, r, t, zero, .. } = self;
        w.comment("Of every region: its step.");
        w.function(&format!("static void {p}_predict_({p}_state *f)"), |w| {
            w.each("r", r, |w| {
                w.block(format_args!("if (!(f->w[r] > {zero}))"), |w| {
                    writeln!(w, "continue;");
                });
                writeln!(w, "const {t} *a = &{p}_a[r * {nn}];");
                writeln!(w, "const {t} *q = &{p}_q[r * {nn}];");
                writeln!(w, "{t} half[{nn}];");
                w.each("i", n, |w| {
                    writeln!(w, "{t} v = {p}_c[r * {n} + i];");
                    w.each("j", n, |w| {
                        writeln!(w, "v += a[i * {n} + j] * f->m[r][j];");
                    });
                    self.driven(w);
                    writeln!(w, "f->next_m[r][i] = v;");
                });
                w.each("i", n, |w| {
                    writeln!(w, "f->m[r][i] = f->next_m[r][i];");
                    self.wrap(w, "i", "f->m[r][i]");
                });
                w.each("i", n, |w| {
                    w.each("j", n, |w| {
                        writeln!(w, "half[i * {n} + j] = {zero};");
                        w.each("k", n, |w| {
                            writeln!(w, "half[i * {n} + j] += a[i * {n} + k] * f->p[r][k * {n} + j];");
                        });
                    });
                });
                w.each("i", n, |w| {
                    w.through("j", "i", |w| {
                        writeln!(w, "{t} v = q[i * {n} + j];");
                        w.each("k", n, |w| {
                            writeln!(w, "v += half[i * {n} + k] * a[j * {n} + k];");
                        });
                        writeln!(w, "f->p[r][i * {n} + j] = v;");
                        writeln!(w, "f->p[r][j * {n} + i] = v;");
                    });
                });
            });
        });
    }

    /// The share of the inputs in a state.
    pub(super) fn driven(&self, w: &mut Writer) {
        if self.inputs.is_empty() {
            return;
        }
        let Self { m, n, p, .. } = self;
        w.each("j", m, |w| {
            writeln!(w, "v += {p}_b[(r * {n} + i) * {m} + j] * f->u[j];");
        });
    }

    /// Takes in one measurement under a region; returns its term of the log-likelihood.
    pub(super) fn observe(&self, w: &mut Writer) {
        let Self { all, p, square, t, .. } = self;
        let one_half = self.c.number(0.5);
        let turn = self.c.number(std::f64::consts::TAU);
        let log = self.c.library("log");
        w.comment("Takes in one measurement under a region; gives what it adds to the logarithm of the likelihood.");
        let head = format!("static {t} {p}_observe_({t} m[{all}], {t} p[{square}], size_t s, {t} z, {t} variance)");
        w.function(&head, |w| {
            writeln!(w, "{t} d = z - m[s];");
            writeln!(w, "{t} gain[{all}];");
            writeln!(w, "{t} half[{square}];");
            self.wrap(w, "s", "d");
            writeln!(w, "const {t} spread = p[s * {all} + s] + variance;");
            w.each("i", all, |w| {
                writeln!(w, "gain[i] = p[i * {all} + s] / spread;");
            });
            w.each("i", all, |w| {
                writeln!(w, "m[i] += gain[i] * d;");
                self.wrap(w, "i", "m[i]");
            });
            w.each("i", all, |w| {
                w.each("j", all, |w| {
                    writeln!(w, "half[i * {all} + j] = p[i * {all} + j] - gain[i] * p[s * {all} + j];");
                });
            });
            w.each("i", all, |w| {
                w.through("j", "i", |w| {
                    writeln!(
                        w,
                        "const {t} v = half[i * {all} + j] - half[i * {all} + s] * gain[j] \
                         + gain[i] * variance * gain[j];"
                    );
                    writeln!(w, "p[i * {all} + j] = v;");
                    writeln!(w, "p[j * {all} + i] = v;");
                });
            });
            writeln!(w, "return -{one_half} * (d * d / spread + {log}({turn} * spread));");
        });
    }

    /// Writes the estimate over all regions.
    pub(super) fn estimate(&self, w: &mut Writer) {
        let Self { p, .. } = self;
        w.comment("The mixture of all regions.");
        w.function(&format!("static void {p}_estimate_({p}_state *f)"), |w| {
            match self.by_state {
                true => self.parts(w),
                false => self.copy_regions(w),
            }
            match self.behind {
                0 => writeln!(w, "{p}_mixture_(f->w, f->next_m, f->next_p, f->x, f->cov);"),
                _ => self.estimate_of_states(w),
            }
        });
    }

    /// Of every region: all of its distribution.
    fn copy_regions(&self, w: &mut Writer) {
        let Self { all, r, square, .. } = self;
        w.each("r", r, |w| {
            w.each("i", all, |w| {
                writeln!(w, "f->next_m[r][i] = f->m[r][i];");
            });
            w.each("i", square, |w| {
                writeln!(w, "f->next_p[r][i] = f->p[r][i];");
            });
        });
    }

    /// Begins at a row.
    pub(super) fn start(&self, w: &mut Writer) {
        let Self { m, n, nn, p, r, sensors, t, zero, .. } = self;
        let finite = self.finite("z[k]");
        let one = self.c.number(1.0);
        w.function(&format!("void {p}_start({p}_state *f, const {t} z[{sensors}])"), |w| {
            w.each("i", n, |w| {
                writeln!(w, "f->x[i] = {p}_prior_mean[i];");
            });
            w.each("i", nn, |w| {
                writeln!(w, "f->cov[i] = {zero};");
            });
            w.each("i", n, |w| {
                writeln!(w, "f->cov[i * {n} + i] = {p}_prior_variance[i];");
            });
            w.each("k", sensors, |w| {
                w.block(format_args!("if ({finite})"), |w| {
                    writeln!(w, "f->x[{p}_sensor[k]] = z[k];");
                    writeln!(w, "f->cov[{p}_sensor[k] * {n} + {p}_sensor[k]] = {p}_start_variance[k];");
                });
            });
            if !self.inputs.is_empty() {
                w.each("i", m, |w| {
                    writeln!(w, "f->u[i] = {zero};");
                });
            }
            writeln!(w, "f->log_likelihood = {zero};");
            w.each("r", r, |w| {
                writeln!(w, "f->w[r] = {one} / ({t}){r};");
                match self.behind {
                    0 => self.white_begin(w),
                    _ => self.coloured_begin(w),
                }
                if self.by_state {
                    self.place_region(w);
                }
            });
            if self.by_state {
                self.shares(w);
            }
        });
    }

    /// Writes the start of every region under white noise.
    fn white_begin(&self, w: &mut Writer) {
        let Self { n, nn, .. } = self;
        w.each("i", n, |w| {
            writeln!(w, "f->m[r][i] = f->x[i];");
        });
        w.each("i", nn, |w| {
            writeln!(w, "f->p[r][i] = f->cov[i];");
        });
    }

    /// Passes to the next row.
    pub(super) fn step(&self, w: &mut Writer) {
        let Self { max, p, r, sensors, t, zero, .. } = self;
        let u = self.u_parameter();
        let finite = self.finite("z[k]");
        let exp = self.c.library("exp");
        let log = self.c.library("log");
        w.function(&format!("void {p}_step({p}_state *f{u}, const {t} z[{sensors}])"), |w| {
            self.take_inputs(w);
            if self.switches {
                self.switch(w);
            }
            self.cross(w);
            writeln!(w, "{t} logarithm[{r}];");
            writeln!(w, "bool observed = false;");
            w.each("k", sensors, |w| {
                writeln!(w, "observed = observed || ({finite});");
            });
            writeln!(w, "f->log_likelihood = {zero};");
            w.block(format_args!("if (observed)"), |w| {
                writeln!(w, "{t} largest = -{max};");
                writeln!(w, "{t} all = {zero};");
                w.each("r", r, |w| {
                    writeln!(w, "logarithm[r] = {zero};");
                    w.block(format_args!("if (f->w[r] > {zero})"), |w| {
                        w.each("k", sensors, |w| {
                            w.block(format_args!("if ({finite})"), |w| {
                                writeln!(
                                    w,
                                    "logarithm[r] += {p}_observe_(f->m[r], f->p[r], {p}_sensor[k], z[k], \
                                     {p}_variance[k]);"
                                );
                            });
                        });
                        if self.by_state {
                            self.evidence(w);
                        }
                        w.block(format_args!("if (logarithm[r] > largest)"), |w| {
                            writeln!(w, "largest = logarithm[r];");
                        });
                    });
                });
                w.each("r", r, |w| {
                    w.block(format_args!("if (f->w[r] > {zero})"), |w| {
                        writeln!(w, "f->w[r] *= {exp}(logarithm[r] - largest);");
                    });
                    writeln!(w, "all += f->w[r];");
                });
                writeln!(w, "f->log_likelihood = largest + {log}(all);");
                writeln!(w, "{p}_likely_(f->w);");
            });
            writeln!(w, "{p}_estimate_(f);");
        });
    }

    /// Inputs that are numbers; where regions read them, a change of an input may be one of region.
    fn take_inputs(&self, w: &mut Writer) {
        if self.inputs.is_empty() {
            return;
        }
        let looks = self.by_state && self.tables.regions_read_inputs;
        let Self { m, max, p, .. } = self;
        if looks {
            writeln!(w, "bool changed = false;");
        }
        w.each("i", m, |w| {
            w.block(format_args!("if (u[i] >= -{max} && u[i] <= {max})"), |w| {
                if looks {
                    writeln!(w, "changed = changed || u[i] < f->u[i] || u[i] > f->u[i];");
                }
                writeln!(w, "f->u[i] = u[i];");
            });
        });
        if looks {
            w.block(format_args!("if (changed)"), |w| {
                writeln!(w, "{p}_remember_(f);");
                self.place_regions(w);
                writeln!(w, "{p}_join_(f);");
            });
        }
    }

    /// One region follows another by counted probabilities.
    fn switch(&self, w: &mut Writer) {
        let Self { p, r, t, zero, .. } = self;
        writeln!(w, "{t} w[{r}];");
        writeln!(w, "{t} share[{r}];");
        w.each("to", r, |w| {
            writeln!(w, "{t} all = {zero};");
            w.each("from", r, |w| {
                writeln!(w, "share[from] = f->w[from] * {p}_transition[from * {r} + to];");
                writeln!(w, "all += share[from];");
            });
            w.each("from", r, |w| {
                writeln!(w, "share[from] /= all;");
            });
            writeln!(w, "w[to] = all;");
            writeln!(w, "{p}_mixture_(share, f->m, f->p, f->next_m[to], f->next_p[to]);");
        });
        writeln!(w, "{p}_take_over_(f, w);");
    }

    /// One step on, over the borders of the regions.
    fn cross(&self, w: &mut Writer) {
        let Self { p, .. } = self;
        if !self.by_state {
            writeln!(w, "{p}_predict_(f);");
            return;
        }
        writeln!(w, "{p}_remember_(f);");
        writeln!(w, "{p}_predict_(f);");
        self.place_regions(w);
        writeln!(w, "{p}_join_(f);");
    }

    /// Writes the evidence of the points for a region after a measurement.
    fn evidence(&self, w: &mut Writer) {
        let Self { p, t, .. } = self;
        let log = self.c.library("log");
        w.scope(|w| {
            writeln!(w, "const {t} before = {p}_mass_(f->place[r], (int16_t)r);");
            self.place_region(w);
            writeln!(w, "logarithm[r] += {log}({p}_mass_(f->place[r], (int16_t)r) / before);");
        });
    }
}
