/* The nearest value within limits. */
static $t $p_project_($t v, size_t j)
{
    if (v < $p_lowest[j]) {
        return $p_lowest[j];
    }
    return (v > $p_highest[j]) ? $p_highest[j] : v;
}

%if bounds
/* Distance of a value beyond a bound. */
static $t $p_violation_(size_t bound, $t x)
{
    if (x > $p_bound_highest[bound]) {
        return x - $p_bound_highest[bound];
    }
    return (x < $p_bound_lowest[bound]) ? (x - $p_bound_lowest[bound]) : 0.0@;
}

%end
/* The state behind a sample in a region. */
static void $p_advance_(const $p_controller *s, size_t region, const $t x[$P_NX], const $t v[$P_NU], $t next[$P_NX])
{
    const $t *a = &$p_a[region * $P_NX * $P_NX];
    const $t *b = &$p_b[region * $P_NX * $P_NU];
    for (size_t i = 0; i < $P_NX; ++i) {
        $t along = 0.0@;
        $t driven = 0.0@;
        for (size_t j = 0; j < $P_NX; ++j) {
            along += a[i * $P_NX + j] * x[j];
        }
        for (size_t j = 0; j < $P_NU; ++j) {
            driven += b[i * $P_NU + j] * v[j];
        }
        next[i] = s->c[region * $P_NX + i] + along + driven;
    }
}

/* The gradient of the objective, by the adjoint recursion. */
static void $p_differentiate_($p_controller *s)
{
    $t later[$P_NX];
    for (size_t k = 1; k <= $P_N; ++k) {
        const $t *x = &s->path[k * $P_NX];
        $t *slope = &s->slopes[k * $P_NX];
        for (size_t i = 0; i < $P_NX; ++i) {
            if (k < $P_N) {
                slope[i] = $p_weight[i] * (x[i] - s->target[i]);
            } else {
                $t sum = 0.0@;
                for (size_t j = 0; j < $P_NX; ++j) {
                    sum += $p_terminal[i * $P_NX + j] * (x[j] - s->target[j]);
                }
                slope[i] = sum;
            }
        }
%if bounds
        for (size_t bound = 0; bound < $P_NB; ++bound) {
            slope[$p_bound_state[bound]] += $p_bound_weight[bound] * $p_violation_(bound, x[$p_bound_state[bound]]);
        }
%end
    }
    for (size_t i = 0; i < $P_NX; ++i) {
        s->slope[i] = s->slopes[$P_N * $P_NX + i];
    }
    for (size_t k = $P_N; k-- > 0;) {
        const $t *a = &$p_a[s->sequence[k] * $P_NX * $P_NX];
        const $t *b = &$p_b[s->sequence[k] * $P_NX * $P_NU];
        for (size_t j = 0; j < $P_NU; ++j) {
            s->input_slopes[k * $P_NU + j] = $p_input_weight[j] * (s->plan[k * $P_NU + j] - s->input_target[j]);
            $t sum = s->input_slopes[k * $P_NU + j];
            for (size_t i = 0; i < $P_NX; ++i) {
                sum += b[i * $P_NU + j] * s->slope[i];
            }
            s->gradient[k * $P_NU + j] = sum;
        }
        for (size_t j = 0; j < $P_NX; ++j) {
            $t sum = s->slopes[k * $P_NX + j];
            for (size_t i = 0; i < $P_NX; ++i) {
                sum += a[i * $P_NX + j] * s->slope[i];
            }
            later[j] = sum;
        }
        for (size_t j = 0; j < $P_NX; ++j) {
            s->slope[j] = later[j];
        }
    }
}

/* Decides the inputs that a direction fixes at a limit, and their moves. */
static void $p_fix_($p_controller *s, bool predicted, $t near)
{
    for (size_t k = 0; k < $P_N; ++k) {
        for (size_t j = 0; j < $P_NU; ++j) {
            const size_t at = k * $P_NU + j;
            const $t v = s->plan[at];
            const $t g = s->gradient[at];
            const $t to = predicted ? (v - g / $p_curvature[j]) : v;
            s->fixed[at] = true;
            if (g < 0.0@ && to >= $p_highest[j] - near) {
                s->move[at] = $p_highest[j] - v;
            } else if (g > 0.0@ && to <= $p_lowest[j] + near) {
                s->move[at] = $p_lowest[j] - v;
            } else {
                s->fixed[at] = false;
                s->move[at] = 0.0@;
            }
        }
    }
}

/* The lower Cholesky factor in place, with the inverse of its diagonal on the diagonal. */
static void $p_cholesky_($t a[$P_NU * $P_NU])
{
    for (size_t j = 0; j < $P_NU; ++j) {
        for (size_t i = j; i < $P_NU; ++i) {
            $t sum = a[i * $P_NU + j];
            for (size_t l = 0; l < j; ++l) {
                sum -= a[i * $P_NU + l] * a[j * $P_NU + l];
            }
            a[i * $P_NU + j] = (i == j) ? (1.0@ / sqrt@(sum)) : (sum * a[j * $P_NU + j]);
        }
    }
}

/* Solves L L' y = b in place, b being a column of a matrix of so many columns. */
static void $p_divide_(const $t factor[$P_NU * $P_NU], $t *b, size_t columns)
{
    for (size_t j = 0; j < $P_NU; ++j) {
        $t sum = b[j * columns];
        for (size_t l = 0; l < j; ++l) {
            sum -= factor[j * $P_NU + l] * b[l * columns];
        }
        b[j * columns] = sum * factor[j * $P_NU + j];
    }
    for (size_t j = $P_NU; j-- > 0;) {
        $t sum = b[j * columns];
        for (size_t l = j + 1; l < $P_NU; ++l) {
            sum -= factor[l * $P_NU + j] * b[l * columns];
        }
        b[j * columns] = sum * factor[j * $P_NU + j];
    }
}

/* Riccati's recursion at a sample: the feedback of its free inputs. */
static void $p_feedback_($p_controller *s, size_t k)
{
    const $t *a = &$p_a[s->sequence[k] * $P_NX * $P_NX];
    const $t *b = &$p_b[s->sequence[k] * $P_NX * $P_NU];
    const bool *fixed = &s->fixed[k * $P_NU];
    $t *gain = &s->gain[k * $P_NU * $P_NX];
    $t *factor = &s->factor[k * $P_NU * $P_NU];
    $t *cross = &s->cross[k * $P_NU * $P_NX];
    bool any = false;
    for (size_t j = 0; j < $P_NU; ++j) {
        any = any || fixed[j];
    }
    if (any) {
        $t driven[$P_NX];
        for (size_t i = 0; i < $P_NX; ++i) {
            driven[i] = 0.0@;
            for (size_t j = 0; j < $P_NU; ++j) {
                driven[i] += b[i * $P_NU + j] * s->move[k * $P_NU + j];
            }
        }
        for (size_t i = 0; i < $P_NX; ++i) {
            for (size_t l = 0; l < $P_NX; ++l) {
                s->slope[i] += s->cost[i * $P_NX + l] * driven[l];
            }
        }
    }
    for (size_t i = 0; i < $P_NX; ++i) {
        for (size_t j = 0; j < $P_NX; ++j) {
            $t sum = 0.0@;
            for (size_t l = 0; l < $P_NX; ++l) {
                sum += s->cost[i * $P_NX + l] * a[l * $P_NX + j];
            }
            s->cost_a[i * $P_NX + j] = sum;
        }
        for (size_t j = 0; j < $P_NU; ++j) {
            $t sum = 0.0@;
            for (size_t l = 0; l < $P_NX; ++l) {
                sum += s->cost[i * $P_NX + l] * b[l * $P_NU + j];
            }
            s->cost_b[i * $P_NU + j] = sum;
        }
    }
    for (size_t j = 0; j < $P_NU; ++j) {
        for (size_t l = 0; l <= j; ++l) {
            $t sum = (l == j) ? ($p_input_weight[j] + s->input_curvature[k * $P_NU + j]) : 0.0@;
            for (size_t i = 0; i < $P_NX; ++i) {
                sum += b[i * $P_NU + j] * s->cost_b[i * $P_NU + l];
            }
            factor[j * $P_NU + l] = (fixed[j] || fixed[l]) ? ((j == l) ? 1.0@ : 0.0@) : sum;
        }
        for (size_t i = 0; i < $P_NX; ++i) {
            $t sum = 0.0@;
            for (size_t l = 0; l < $P_NX; ++l) {
                sum += b[l * $P_NU + j] * s->cost_a[l * $P_NX + i];
            }
            cross[j * $P_NX + i] = fixed[j] ? 0.0@ : sum;
            gain[j * $P_NX + i] = -cross[j * $P_NX + i];
        }
    }
    $p_cholesky_(factor);
    for (size_t i = 0; i < $P_NX; ++i) {
        $p_divide_(factor, &gain[i], $P_NX);
    }
}

/* The constant of the feedback of sample k. */
static void $p_constant_($p_controller *s, size_t k)
{
    const $t *b = &$p_b[s->sequence[k] * $P_NX * $P_NU];
    $t *constant = &s->constant[k * $P_NU];
    for (size_t j = 0; j < $P_NU; ++j) {
        $t sum = s->input_slopes[k * $P_NU + j];
        for (size_t i = 0; i < $P_NX; ++i) {
            sum += b[i * $P_NU + j] * s->slope[i];
        }
        constant[j] = s->fixed[k * $P_NU + j] ? 0.0@ : -sum;
    }
    $p_divide_(&s->factor[k * $P_NU * $P_NU], constant, 1);
}

/* The slope of the cost of the state of sample k. */
static void $p_earlier_slope_($p_controller *s, size_t k)
{
    const $t *a = &$p_a[s->sequence[k] * $P_NX * $P_NX];
    const $t *cross = &s->cross[k * $P_NU * $P_NX];
    $t later[$P_NX];
    for (size_t j = 0; j < $P_NX; ++j) {
        $t sum = s->slopes[k * $P_NX + j];
        for (size_t i = 0; i < $P_NX; ++i) {
            sum += a[i * $P_NX + j] * s->slope[i];
        }
        for (size_t l = 0; l < $P_NU; ++l) {
            sum += cross[l * $P_NX + j] * s->constant[k * $P_NU + l];
        }
        later[j] = sum;
    }
    for (size_t j = 0; j < $P_NX; ++j) {
        s->slope[j] = later[j];
    }
}

/* The curvature of the cost of the state of sample k. */
static void $p_earlier_cost_($p_controller *s, size_t k)
{
    const $t *a = &$p_a[s->sequence[k] * $P_NX * $P_NX];
    const $t *gain = &s->gain[k * $P_NU * $P_NX];
    const $t *cross = &s->cross[k * $P_NU * $P_NX];
    for (size_t j = 0; j < $P_NX; ++j) {
        for (size_t i = 0; i <= j; ++i) {
            $t sum = (i == j) ? $p_weight[j] : 0.0@;
            for (size_t l = 0; l < $P_NX; ++l) {
                sum += a[l * $P_NX + j] * s->cost_a[l * $P_NX + i];
            }
            for (size_t l = 0; l < $P_NU; ++l) {
                sum += cross[l * $P_NX + j] * gain[l * $P_NX + i];
            }
            s->cost[j * $P_NX + i] = sum;
            s->cost[i * $P_NX + j] = sum;
        }
    }
}

/* The move of the free inputs that minimises the second-order model of slopes and curvatures. If only slopes are other
   than before, `fresh` is false, no input is fixed, and the factors are those of before. */
static void $p_minimise_($p_controller *s, bool fresh)
{
    if (fresh) {
        for (size_t i = 0; i < $P_NX * $P_NX; ++i) {
            s->cost[i] = $p_terminal[i];
        }
    }
    for (size_t i = 0; i < $P_NX; ++i) {
        s->slope[i] = s->slopes[$P_N * $P_NX + i];
        s->displaced[i] = 0.0@;
    }
    for (size_t k = $P_N; k-- > 0;) {
        if (fresh) {
%if bounds
            for (size_t bound = 0; bound < $P_NB; ++bound) {
                s->cost[$p_bound_state[bound] * ($P_NX + 1)] += s->bound_curvature[k * $P_NB + bound];
            }
%end
            $p_feedback_(s, k);
        }
        $p_constant_(s, k);
        if (k > 0) {
            $p_earlier_slope_(s, k);
            if (fresh) {
                $p_earlier_cost_(s, k);
            }
        }
    }
    for (size_t k = 0; k < $P_N; ++k) {
        const $t *a = &$p_a[s->sequence[k] * $P_NX * $P_NX];
        const $t *b = &$p_b[s->sequence[k] * $P_NX * $P_NU];
        const $t *x = &s->displaced[k * $P_NX];
        for (size_t j = 0; j < $P_NU; ++j) {
            const size_t at = k * $P_NU + j;
            if (!s->fixed[at]) {
                $t sum = s->constant[at];
                for (size_t i = 0; i < $P_NX; ++i) {
                    sum += s->gain[at * $P_NX + i] * x[i];
                }
                s->move[at] = sum;
            }
        }
        for (size_t i = 0; i < $P_NX; ++i) {
            $t sum = 0.0@;
            for (size_t l = 0; l < $P_NX; ++l) {
                sum += a[i * $P_NX + l] * x[l];
            }
            for (size_t j = 0; j < $P_NU; ++j) {
                sum += b[i * $P_NU + j] * s->move[k * $P_NU + j];
            }
            s->displaced[(k + 1) * $P_NX + i] = sum;
        }
    }
}

/* The Newton direction with some inputs fixed. */
static void $p_find_($p_controller *s, bool predicted, $t near)
{
    $p_fix_(s, predicted, near);
    for (size_t i = 0; i < $P_N * $P_NU; ++i) {
        s->input_curvature[i] = 0.0@;
    }
%if bounds
    for (size_t k = 0; k < $P_N; ++k) {
        for (size_t bound = 0; bound < $P_NB; ++bound) {
            const $t x = s->path[(k + 1) * $P_NX + $p_bound_state[bound]];
            const bool beyond = x > $p_bound_highest[bound] || x < $p_bound_lowest[bound];
            s->bound_curvature[k * $P_NB + bound] = beyond ? $p_bound_weight[bound] : 0.0@;
        }
    }
%end
    $p_minimise_(s, true);
}

/* The objective's change by s->change without the linear part. */
static $t $p_curving_($p_controller *s)
{
    $t sum = 0.0@;
    for (size_t k = 0; k < $P_N; ++k) {
        for (size_t j = 0; j < $P_NU; ++j) {
            const $t change = s->change[k * $P_NU + j];
            sum += $p_input_weight[j] * change * change;
        }
    }
    for (size_t i = 0; i < $P_NX; ++i) {
        s->off[i] = 0.0@;
    }
    for (size_t k = 0; k < $P_N; ++k) {
        const $t *a = &$p_a[s->sequence[k] * $P_NX * $P_NX];
        const $t *b = &$p_b[s->sequence[k] * $P_NX * $P_NU];
        const $t *now = &s->off[k * $P_NX];
        $t *next = &s->off[(k + 1) * $P_NX];
        for (size_t i = 0; i < $P_NX; ++i) {
            $t along = 0.0@;
            $t driven = 0.0@;
            for (size_t j = 0; j < $P_NX; ++j) {
                along += a[i * $P_NX + j] * now[j];
            }
            for (size_t j = 0; j < $P_NU; ++j) {
                driven += b[i * $P_NU + j] * s->change[k * $P_NU + j];
            }
            next[i] = along + driven;
        }
        for (size_t i = 0; i < $P_NX; ++i) {
            if (k + 1 < $P_N) {
                sum += next[i] * ($p_weight[i] * next[i]);
            } else {
                $t along = 0.0@;
                for (size_t j = 0; j < $P_NX; ++j) {
                    along += $p_terminal[i * $P_NX + j] * next[j];
                }
                sum += next[i] * along;
            }
        }
%if bounds
        for (size_t bound = 0; bound < $P_NB; ++bound) {
            const size_t i = $p_bound_state[bound];
            const $t x = s->path[(k + 1) * $P_NX + i];
            const $t before = $p_violation_(bound, x);
            const $t after = $p_violation_(bound, x + next[i]);
            sum += $p_bound_weight[bound] * (after * after - before * before - 2.0@ * before * next[i]);
        }
%end
    }
    return 0.5@ * sum;
}

/* Moves the plan by a share of the direction, if that decreases the objective enough. */
static bool $p_takes_($p_controller *s, $t share)
{
    $t slope = 0.0@;
    for (size_t k = 0; k < $P_N; ++k) {
        for (size_t j = 0; j < $P_NU; ++j) {
            const size_t at = k * $P_NU + j;
            s->change[at] = $p_project_(s->plan[at] + share * s->move[at], j) - s->plan[at];
            slope += s->gradient[at] * s->change[at];
        }
    }
    if (!(slope < 0.0@ && slope + $p_curving_(s) <= $decrease * slope)) {
        return false;
    }
    for (size_t k = 0; k < $P_N; ++k) {
        for (size_t j = 0; j < $P_NU; ++j) {
            const size_t at = k * $P_NU + j;
            s->plan[at] = $p_project_(s->plan[at] + share * s->move[at], j);
        }
    }
    return true;
}

/* A step that decreases the objective; false if there is none. */
static bool $p_improve_($p_controller *s, $t residual)
{
    $t share = 1.0@;
    $p_find_(s, true, 0.0@);
    if ($p_takes_(s, share)) {
        return true;
    }
    $p_find_(s, false, (residual < $near) ? residual : $near);
    for (int halving = 0; halving < $halvings; ++halving) {
        if ($p_takes_(s, share)) {
            return true;
        }
        share *= 0.5@;
    }
    return false;
}

/* Follows the plan through the present sequence of regions. */
static void $p_trace_($p_controller *s)
{
    for (size_t i = 0; i < $P_NX; ++i) {
        s->path[i] = s->start[i];
    }
    for (size_t k = 0; k < $P_N; ++k) {
        $p_advance_(s, s->sequence[k], &s->path[k * $P_NX], &s->plan[k * $P_NU], &s->path[(k + 1) * $P_NX]);
    }
}

/* Newton steps, at most so many; 0 if the residual is small. */
static int $p_descend_($p_controller *s, int most, $t *residual)
{
    for (int step = 0;; ++step) {
        $p_trace_(s);
        $p_differentiate_(s);
        *residual = 0.0@;
        for (size_t k = 0; k < $P_N; ++k) {
            for (size_t j = 0; j < $P_NU; ++j) {
                const $t v = s->plan[k * $P_NU + j];
                const $t to = $p_project_(v - s->gradient[k * $P_NU + j] / $p_curvature[j], j);
                const $t off = (v > to) ? (v - to) : (to - v);
                if (!(off <= *residual)) {
                    *residual = off;
                }
            }
        }
        if (*residual <= $solved) {
            return 0;
        }
        if (step == most || !$p_improve_(s, *residual)) {
            return 1;
        }
        ++s->steps;
    }
}

/* Limit, value and softness of an inequality sign y <= sign limit + softness multiplier; false without a limit. */
static bool $p_inequality_(const $p_controller *s, size_t at, $t *room, $t *softness, size_t *y)
{
    const size_t pair = at / 2;
    const bool upper = at % 2 == 1;
    $t limit;
    $t value;
%if bounds
    if (pair >= $P_N * $P_NU) {
        const size_t bound = (pair - $P_N * $P_NU) % $P_NB;
        *y = ((pair - $P_N * $P_NU) / $P_NB + 1) * $P_NX + $p_bound_state[bound];
        *softness = 1.0@ / $p_bound_weight[bound];
        limit = upper ? $p_bound_highest[bound] : $p_bound_lowest[bound];
        value = s->path[*y];
    } else {
        *y = pair;
        *softness = 0.0@;
        limit = upper ? $p_highest[pair % $P_NU] : $p_lowest[pair % $P_NU];
        value = s->plan[pair];
    }
%else
    *y = pair;
    *softness = 0.0@;
    limit = upper ? $p_highest[pair % $P_NU] : $p_lowest[pair % $P_NU];
    value = s->plan[pair];
%end
    *room = upper ? (limit - value) : (value - limit);
    return limit < $unlimited && limit > -$unlimited;
}

/* Mean product of slacks and multipliers after a share of their moves. */
static $t $p_complementarity_(const $p_controller *s, $t share)
{
    $t sum = 0.0@;
    $t count = 0.0@;
    for (size_t at = 0; at < $P_NI; ++at) {
        $t room;
        $t softness;
        size_t y;
        if ($p_inequality_(s, at, &room, &softness, &y)) {
            sum += (s->slack[at] + share * s->slack_move[at]) * (s->multiplier[at] + share * s->multiplier_move[at]);
            count += 1.0@;
        }
    }
    return (count > 0.0@) ? (sum / count) : 0.0@;
}

/* Moves of plan, slacks and multipliers for the wanted centring; the longest share that keeps them positive. */
static $t $p_step_inside_($p_controller *s, bool fresh)
{
    $t share = 1.0@;
    $t room;
    $t softness;
    size_t y;
    for (size_t i = 0; i < ($P_N + 1) * $P_NX; ++i) {
        s->slopes[i] = s->own_slopes[i];
    }
    for (size_t i = 0; i < $P_N * $P_NU; ++i) {
        s->input_slopes[i] = s->own_input_slopes[i];
        s->input_curvature[i] = 0.0@;
    }
%if bounds
    for (size_t i = 0; i < $P_N * $P_NB; ++i) {
        s->bound_curvature[i] = 0.0@;
    }
%end
    for (size_t at = 0; at < $P_NI; ++at) {
        if ($p_inequality_(s, at, &room, &softness, &y)) {
            const $t sign = (at % 2 == 1) ? 1.0@ : -1.0@;
            const $t width = s->slack[at] + s->multiplier[at] * softness;
            const $t miss = room + softness * s->multiplier[at] - s->slack[at];
            const $t slope = sign * (s->multiplier[at] + (s->centring[at] - s->multiplier[at] * miss) / width);
%if bounds
            if (at >= 2 * $P_N * $P_NU) {
                s->bound_curvature[at / 2 - $P_N * $P_NU] += s->multiplier[at] / width;
                s->slopes[y] += slope;
                continue;
            }
%end
            s->input_curvature[at / 2] += s->multiplier[at] / width;
            s->input_slopes[y] += slope;
        }
    }
    $p_minimise_(s, fresh);
    for (size_t at = 0; at < $P_NI; ++at) {
        if ($p_inequality_(s, at, &room, &softness, &y)) {
            const $t sign = (at % 2 == 1) ? 1.0@ : -1.0@;
            const $t moved = sign * ((at >= 2 * $P_N * $P_NU) ? s->displaced[y] : s->move[y]);
            const $t width = s->slack[at] + s->multiplier[at] * softness;
            const $t miss = room + softness * s->multiplier[at] - s->slack[at];
            const $t multiplier_move = (s->centring[at] + s->multiplier[at] * (moved - miss)) / width;
            const $t slack_move = miss - moved + softness * multiplier_move;
            if (s->slack[at] + share * slack_move < 0.0@) {
                share = -s->slack[at] / slack_move;
            }
            if (s->multiplier[at] + share * multiplier_move < 0.0@) {
                share = -s->multiplier[at] / multiplier_move;
            }
            s->slack_move[at] = slack_move;
            s->multiplier_move[at] = multiplier_move;
        }
    }
    return share;
}

/* Moves the plan near to the minimum, by Mehrotra's predictor and corrector. */
static void $p_approach_($p_controller *s)
{
    $t size = 0.0@;
    $t first = 0.0@;
    for (size_t j = 0; j < $P_NU; ++j) {
        size = ($p_curvature[j] > size) ? $p_curvature[j] : size;
    }
    $p_trace_(s);
    for (size_t at = 0; at < $P_NI; ++at) {
        $t room;
        $t softness;
        size_t y;
        const bool limited = $p_inequality_(s, at, &room, &softness, &y);
        s->slack[at] = (limited && room > 1.0@) ? room : 1.0@;
        s->multiplier[at] = size;
        s->slack_move[at] = 0.0@;
        s->multiplier_move[at] = 0.0@;
    }
    for (size_t i = 0; i < $P_N * $P_NU; ++i) {
        s->fixed[i] = false;
    }
    for (int iteration = 0; iteration < $iterations; ++iteration) {
        $p_trace_(s);
        $p_differentiate_(s);
%if bounds
        for (size_t k = 1; k <= $P_N; ++k) {
            for (size_t bound = 0; bound < $P_NB; ++bound) {
                const size_t i = k * $P_NX + $p_bound_state[bound];
                s->slopes[i] -= $p_bound_weight[bound] * $p_violation_(bound, s->path[i]);
            }
        }
%end
        for (size_t i = 0; i < ($P_N + 1) * $P_NX; ++i) {
            s->own_slopes[i] = s->slopes[i];
        }
        for (size_t i = 0; i < $P_N * $P_NU; ++i) {
            s->own_input_slopes[i] = s->input_slopes[i];
        }
        const $t mean = $p_complementarity_(s, 0.0@);
        first = (iteration == 0) ? mean : first;
        if (!(mean > $centred * first)) {
            return;
        }
        for (size_t at = 0; at < $P_NI; ++at) {
            s->centring[at] = -s->slack[at] * s->multiplier[at];
        }
        const $t ratio = $p_complementarity_(s, $p_step_inside_(s, true)) / mean;
        const $t centre = ratio * ratio * ratio * mean;
        for (size_t at = 0; at < $P_NI; ++at) {
            s->centring[at] += centre - s->slack_move[at] * s->multiplier_move[at];
        }
        const $t share = $inside * $p_step_inside_(s, false);
        ++s->steps;
        for (size_t i = 0; i < $P_N * $P_NU; ++i) {
            s->plan[i] += share * s->move[i];
        }
        for (size_t at = 0; at < $P_NI; ++at) {
            s->slack[at] += share * s->slack_move[at];
            s->multiplier[at] += share * s->multiplier_move[at];
        }
    }
}

/* Projects the plan onto the limits. */
static void $p_limit_($p_controller *s)
{
    for (size_t k = 0; k < $P_N; ++k) {
        for (size_t j = 0; j < $P_NU; ++j) {
            s->plan[k * $P_NU + j] = $p_project_(s->plan[k * $P_NU + j], j);
        }
    }
}

/* Improves the plan to the minimum for the present sequence of regions; 0 if it is found. */
static int $p_solve_($p_controller *s, $t *residual)
{
    $p_limit_(s);
    if ($p_descend_(s, $first_steps, residual) == 0) {
        return 0;
    }
    $p_approach_(s);
    $p_limit_(s);
    return $p_descend_(s, $last_steps, residual);
}

%if regions
/* The cost of the plan along s->path. */
static $t $p_cost_(const $p_controller *s)
{
    $t cost = 0.0@;
    for (size_t k = 0; k < $P_N; ++k) {
        for (size_t j = 0; j < $P_NU; ++j) {
            const $t off = s->plan[k * $P_NU + j] - s->input_target[j];
            cost += $p_input_weight[j] * off * off;
        }
    }
    for (size_t k = 0; k <= $P_N; ++k) {
        const $t *x = &s->path[k * $P_NX];
        for (size_t i = 0; i < $P_NX; ++i) {
            const $t off = x[i] - s->target[i];
            if (k < $P_N) {
                cost += $p_weight[i] * off * off;
            } else {
                $t along = 0.0@;
                for (size_t j = 0; j < $P_NX; ++j) {
                    along += $p_terminal[i * $P_NX + j] * (x[j] - s->target[j]);
                }
                cost += along * off;
            }
        }
%if bounds
        for (size_t bound = 0; bound < $P_NB; ++bound) {
            const $t violation = (k > 0) ? $p_violation_(bound, x[$p_bound_state[bound]]) : 0.0@;
            cost += $p_bound_weight[bound] * violation * violation;
        }
%end
    }
    return 0.5@ * cost;
}

%end
/* Follows the plan, and the linear law behind its first samples, through the regions that they meet. */
static void $p_follow_($p_controller *s, $row_parametersize_t kept)
{
    size_t region = 0;
    for (size_t i = 0; i < $P_NX; ++i) {
        s->path[i] = s->start[i];
    }
    for (size_t k = 0; k < $P_N; ++k) {
        const $t *x = &s->path[k * $P_NX];
        $t *v = &s->plan[k * $P_NU];
        for (size_t j = 0; j < $P_NU; ++j) {
            if (k >= kept) {
                $t sum = s->input_target[j];
                for (size_t i = 0; i < $P_NX; ++i) {
                    sum -= $p_law[j * $P_NX + i] * (x[i] - s->target[i]);
                }
                v[j] = sum;
            }
            v[j] = $p_project_(v[j], j);
        }
%if regions
$predicted_row
        const int met = $p_region_(row);
        region = (met >= 0) ? (size_t)met : region;
%end
        s->met[k] = ($index)region;
        $p_advance_(s, region, x, v, &s->path[(k + 1) * $P_NX]);
    }
}

void $p_init($p_controller *s)
{
    for (size_t j = 0; j < $P_NU; ++j) {
        s->command[j] = $p_command[j];
    }
%if integrals
    for (size_t i = 0; i < $P_NQ; ++i) {
        s->integral[i] = 0.0@;
    }
%end
    for (size_t i = 0; i < $P_N * $P_NU; ++i) {
        s->plan[i] = 0.0@;
    }
    for (size_t i = 0; i < $P_NX; ++i) {
        s->slopes[i] = 0.0@;
    }
    s->residual = 0.0@;
    s->steps = 0;
    s->began = false;
}

int $p_step($p_controller *s, const $t u[$reads])
{
    $t row[$columns];
    $t error[$measurements];
    for (size_t i = 0; i < $reads; ++i) {
        row[i] = u[i];
    }
$driven_row
    const int finite = $p_measure_(row, error);
    if (finite <= $P_NOT_FINITE) {
        return finite;
    }
%if regions
    const int region = $p_region_(row);
    if (region < 0) {
        return region;
    }
%end
%if integrals
    $t grown[$P_NQ];
    bool outwards = false;
    for (size_t i = 0; i < $P_NQ; ++i) {
        grown[i] = $period * error[$p_integrated[i]] + s->integral[i];
    }
    for (size_t j = 0; j < $P_NU; ++j) {
        $t push = 0.0@;
        for (size_t i = 0; i < $P_NQ; ++i) {
            push += $p_integral_gain[($region * $P_NU + j) * $P_NQ + i] * (s->integral[i] - grown[i]);
        }
        outwards = outwards || (s->command[j] >= $p_highest_command[j] && push > 0.0@);
        outwards = outwards || (s->command[j] <= $p_lowest_command[j] && push < 0.0@);
    }
    for (size_t i = 0; i < $P_NQ; ++i) {
        s->integral[i] = outwards ? s->integral[i] : grown[i];
    }
%end
    for (size_t i = 0; i < $P_NE; ++i) {
        s->start[i] = error[i] / $p_size[i];
    }
%if integrals
    for (size_t i = 0; i < $P_NQ; ++i) {
        s->start[$P_NE + i] = s->integral[i] / $p_size[$P_NE + i];
    }
%end
    for (size_t i = 0; i < $P_NR * $P_NX; ++i) {
        s->c[i] = $p_c[i];
    }
    for (size_t i = 0; i < $P_NX; ++i) {
        s->target[i] = $p_target[i];
    }
    for (size_t i = 0; i < $P_NU; ++i) {
        s->input_target[i] = $p_input_target[i];
    }
%if measured
    for (size_t j = 0; j < $P_NW; ++j) {
        const $t w = error[$P_NE + j];
        for (size_t i = 0; i < $P_NR * $P_NX; ++i) {
            s->c[i] += $p_c_slope[i * $P_NW + j] * w;
        }
        for (size_t i = 0; i < $P_NX; ++i) {
            s->target[i] += $p_target_slope[i * $P_NW + j] * w;
        }
        for (size_t i = 0; i < $P_NU; ++i) {
            s->input_target[i] += $p_input_target_slope[i * $P_NW + j] * w;
        }
    }
%end
    for (size_t i = 0; i + $P_NU < $P_N * $P_NU; ++i) {
        s->plan[i] = s->plan[i + $P_NU];
    }
    $p_follow_(s, $row_argument(s->began ? $P_N - 1 : 0));
    s->began = true;
    s->steps = 0;
%if regions
    int status = 1;
    $t least = $p_cost_(s);
    for (size_t i = 0; i < $P_N * $P_NU; ++i) {
        s->best[i] = s->plan[i];
    }
    for (int round = 0; round < $sequences; ++round) {
        $t residual = 0.0@;
        bool settled = true;
        for (size_t k = 0; k < $P_N; ++k) {
            s->sequence[k] = s->met[k];
        }
        const int solved = $p_solve_(s, &residual);
        $p_follow_(s, $row_argument$P_N);
        const $t cost = $p_cost_(s);
        for (size_t k = 0; k < $P_N; ++k) {
            settled = settled && s->met[k] == s->sequence[k];
        }
        if (cost < least || settled) {
            status = (settled && cost <= least) ? solved : 1;
            s->residual = residual;
        }
        if (cost < least) {
            least = cost;
            for (size_t i = 0; i < $P_N * $P_NU; ++i) {
                s->best[i] = s->plan[i];
            }
        }
        if (settled) {
            break;
        }
    }
    for (size_t i = 0; i < $P_N * $P_NU; ++i) {
        s->plan[i] = s->best[i];
    }
%else
    for (size_t k = 0; k < $P_N; ++k) {
        s->sequence[k] = s->met[k];
    }
    const int status = $p_solve_(s, &s->residual);
%end
    for (size_t j = 0; j < $P_NU; ++j) {
        const $t command = $p_input_size[j] * s->plan[j] + $p_at[j];
        if (command < $p_lowest_command[j]) {
            s->command[j] = $p_lowest_command[j];
        } else {
            s->command[j] = (command > $p_highest_command[j]) ? $p_highest_command[j] : command;
        }
    }
    return status;
}
