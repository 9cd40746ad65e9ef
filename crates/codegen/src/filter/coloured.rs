//! The C code of a filter whose process noise hangs on that of the rows before: the whitened residuals of those rows stand behind the states.

/// The functions of `filter.c.txt` that are others here: from which words to which, and what stands there.
pub(super) const FUNCTIONS: [(&str, &str, &str); 2] = [
    ("/* The normal distribution of those", "/* The normal distribution with the moments", PART),
    ("/* Of every region: its step", "/* Takes in one measurement", PREDICT),
];

/// The estimate of the states alone.
pub(super) const ESTIMATE: &str = "@T@ m[@A@];
@T@ p[@AA@];
@P@_mixture_(f->w, f->next_m, f->next_p, m, p);
for (size_t i = 0; i < @N@; ++i) {
    f->x[i] = m[i];
    for (size_t j = 0; j < @N@; ++j) {
        f->cov[i * @N@ + j] = p[i * @A@ + j];
    }
}";

/// What every region begins with.
pub(super) const BEGIN: &str = "for (size_t i = 0; i < @A@; ++i) {
    f->m[r][i] = (i < @N@) ? f->x[i] : #0.0#;
    for (size_t j = 0; j < @A@; ++j) {
        @T@ v = #0.0#;
        if (i < @N@ && j < @N@) {
            v = f->cov[i * @N@ + j];
        }
        if (i >= @N@ && j >= @N@) {
            v = @P@_lasting[(i - @N@) * @H@ + j - @N@];
        }
        f->p[r][i * @A@ + j] = v;
    }
}";

/// Points stand for states; the residuals behind them follow by regression.
const PART: &str = "/* The normal distribution of those points that are marked. */
static void @P@_part_(const @T@ m[@A@], const @T@ p[@AA@], const bool inside[@POINTS@], @T@ pm[@A@], @T@ pp[@AA@])
{
    size_t count = 0;
    for (size_t i = 0; i < @POINTS@; ++i) {
        count += inside[i] ? 1U : 0U;
    }
    for (size_t i = 0; i < @A@; ++i) {
        pm[i] = m[i];
    }
    for (size_t i = 0; i < @AA@; ++i) {
        pp[i] = p[i];
    }
    if (count == 0 || count == @POINTS@) {
        return;
    }
    @T@ l[@NN@];
    @T@ first[@NN@];
    @T@ offset[@N@];
    @T@ centre[@N@] = { #0.0# };
    @P@_factor_(p, l);
    for (size_t i = 0; i < @POINTS@; ++i) {
        if (inside[i]) {
            @P@_offset_(l, i, offset);
            for (size_t s = 0; s < @N@; ++s) {
                centre[s] += offset[s];
            }
        }
    }
    for (size_t s = 0; s < @N@; ++s) {
        centre[s] /= (@T@)count;
    }
    for (size_t a = 0; a < @N@; ++a) {
        for (size_t b = 0; b < @N@; ++b) {
            first[a * @N@ + b] = #2.0# * p[a * @A@ + b];
        }
    }
    for (size_t i = 0; i < @POINTS@; ++i) {
        if (inside[i]) {
            @P@_offset_(l, i, offset);
            for (size_t a = 0; a < @N@; ++a) {
                for (size_t b = 0; b <= a; ++b) {
                    first[a * @N@ + b] += (offset[a] - centre[a]) * (offset[b] - centre[b]);
                }
            }
        }
    }
    for (size_t a = 0; a < @N@; ++a) {
        for (size_t b = 0; b <= a; ++b) {
            first[a * @N@ + b] /= (@T@)count + #2.0#;
            first[b * @N@ + a] = first[a * @N@ + b];
        }
        pm[a] = m[a] + centre[a];
        @WRAPPM@
    }
    for (size_t a = 0; a < @N@; ++a) {
        for (size_t b = 0; b < @N@; ++b) {
            pp[a * @A@ + b] = first[a * @N@ + b];
        }
    }
    @T@ gain[@H@][@N@];
    for (size_t h = 0; h < @H@; ++h) {
        for (size_t i = 0; i < @N@; ++i) {
            @T@ v = p[(@N@ + h) * @A@ + i];
            for (size_t k = 0; k < i; ++k) {
                v -= l[i * @N@ + k] * gain[h][k];
            }
            gain[h][i] = (l[i * @N@ + i] > #0.0#) ? v / l[i * @N@ + i] : #0.0#;
        }
        for (size_t i = @N@; i-- > 0;) {
            @T@ v = gain[h][i];
            for (size_t k = i + 1; k < @N@; ++k) {
                v -= l[k * @N@ + i] * gain[h][k];
            }
            gain[h][i] = (l[i * @N@ + i] > #0.0#) ? v / l[i * @N@ + i] : #0.0#;
        }
    }
    for (size_t h = 0; h < @H@; ++h) {
        for (size_t k = 0; k < @N@; ++k) {
            pm[@N@ + h] += gain[h][k] * centre[k];
        }
        for (size_t j = 0; j < @N@; ++j) {
            @T@ both = #0.0#;
            @T@ change = #0.0#;
            for (size_t k = 0; k < @N@; ++k) {
                both += gain[h][k] * first[k * @N@ + j];
                change += gain[h][k] * (first[k * @N@ + j] - p[k * @A@ + j]);
            }
            pp[(@N@ + h) * @A@ + j] = both;
            pp[j * @A@ + @N@ + h] = both;
            offset[j] = change;
        }
        for (size_t o = 0; o <= h; ++o) {
            @T@ v = p[(@N@ + h) * @A@ + @N@ + o];
            for (size_t j = 0; j < @N@; ++j) {
                v += offset[j] * gain[o][j];
            }
            pp[(@N@ + h) * @A@ + @N@ + o] = v;
            pp[(@N@ + o) * @A@ + @N@ + h] = v;
        }
    }
}

";

/// The residuals one row on, then the states.
const PREDICT: &str = "/* Of every region: its step, and the residuals that its noise hangs on. */
static void @P@_predict_(@P@_state *f)
{
    for (size_t r = 0; r < @R@; ++r) {
        if (!(f->w[r] > #0.0#)) {
            continue;
        }
        const @T@ *a = &@P@_a[r * @NN@];
        const @T@ *q = &@P@_q[r * @NN@];
        const @T@ *s = &@P@_s[r * (@N@ * @Q@)];
        @T@ *p = f->p[r];
        @T@ m[@A@];
        @T@ half[@AA@];
        @T@ moved[@AA@];
        for (size_t i = 0; i < @A@; ++i) {
            m[i] = (i < @N@ + @Q@) ? #0.0# : f->m[r][i - @Q@];
            for (size_t j = 0; j < @A@; ++j) {
                half[i * @A@ + j] = (i < @N@ + @Q@) ? p[i * @A@ + j] : p[(i - @Q@) * @A@ + j];
                moved[i * @A@ + j] = p[i * @A@ + j];
            }
        }
        for (size_t i = 0; i < @Q@; ++i) {
            for (size_t j = 0; j < @A@; ++j) {
                half[(@N@ + i) * @A@ + j] = #0.0#;
            }
            for (size_t k = 0; k < @H@; ++k) {
                m[@N@ + i] += @P@_phi[i * @H@ + k] * f->m[r][@N@ + k];
                for (size_t j = 0; j < @A@; ++j) {
                    half[(@N@ + i) * @A@ + j] += @P@_phi[i * @H@ + k] * p[(@N@ + k) * @A@ + j];
                }
            }
        }
        for (size_t i = @N@; i < @A@; ++i) {
            for (size_t j = 0; j <= i; ++j) {
                @T@ v = #0.0#;
                if (j < @N@) {
                    v = half[i * @A@ + j];
                } else if (j < @N@ + @Q@) {
                    v = (i < @N@ + @Q@) ? @P@_new[(i - @N@) * @Q@ + j - @N@] : #0.0#;
                    for (size_t k = 0; k < @H@; ++k) {
                        v += half[i * @A@ + @N@ + k] * @P@_phi[(j - @N@) * @H@ + k];
                    }
                } else {
                    v = half[i * @A@ + j - @Q@];
                }
                moved[i * @A@ + j] = v;
                moved[j * @A@ + i] = v;
            }
        }
        for (size_t i = 0; i < @N@; ++i) {
            @T@ v = @P@_c[r * @N@ + i];
            for (size_t j = 0; j < @N@; ++j) {
                v += a[i * @N@ + j] * f->m[r][j];
            }
            @BU@
            for (size_t t = 0; t < @Q@; ++t) {
                v += s[i * @Q@ + t] * m[@N@ + t];
            }
            m[i] = v;
            for (size_t j = 0; j < @A@; ++j) {
                half[i * @A@ + j] = #0.0#;
            }
            for (size_t k = 0; k < @N@; ++k) {
                for (size_t j = 0; j < @A@; ++j) {
                    half[i * @A@ + j] += a[i * @N@ + k] * moved[k * @A@ + j];
                }
            }
            for (size_t t = 0; t < @Q@; ++t) {
                for (size_t j = 0; j < @A@; ++j) {
                    half[i * @A@ + j] += s[i * @Q@ + t] * moved[(@N@ + t) * @A@ + j];
                }
            }
        }
        for (size_t i = 0; i < @A@; ++i) {
            f->m[r][i] = m[i];
            @WRAPFM@
            for (size_t j = 0; j < @A@; ++j) {
                p[i * @A@ + j] = moved[i * @A@ + j];
            }
        }
        for (size_t i = 0; i < @N@; ++i) {
            for (size_t j = 0; j <= i; ++j) {
                @T@ v = q[i * @N@ + j];
                for (size_t k = 0; k < @N@; ++k) {
                    v += half[i * @A@ + k] * a[j * @N@ + k];
                }
                for (size_t t = 0; t < @Q@; ++t) {
                    v += half[i * @A@ + @N@ + t] * s[j * @Q@ + t];
                }
                p[i * @A@ + j] = v;
                p[j * @A@ + i] = v;
            }
            for (size_t j = @N@; j < @A@; ++j) {
                p[i * @A@ + j] = half[i * @A@ + j];
                p[j * @A@ + i] = half[i * @A@ + j];
            }
        }
    }
}

";
