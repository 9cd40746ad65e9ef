//! The windows of a task by its rows: whether there are to be any, and how long they are.

use fleetfoot_data::Source;
use fleetfoot_data::setting::{STATES_SECTION, WEAK};
use fleetfoot_library::{CentralDifference, Expr, Spacing};
use fleetfoot_recipe::Error as RecipeError;
use fleetfoot_sums::system::{
    LEAST_REACH, Rate, Weak, WeakTarget, sampled_mean_squares, sampled_variances, weak_accuracy,
};

use crate::{
    equations::{EquationTask, FittedEquation},
    error::Error,
    windows::{NOISE, WeakForm, Windows},
};

/// The longest episode has room for so many reaches, at least.
const ROOM: usize = 16;
/// Error of rates that no model is better than another by, at least: recordings of simulations err by some of it themselves.
const ACCURACY: f64 = 1e-6;
/// Lags at which changes are measured.
const LAGS: [i32; 18] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512];

impl EquationTask {
    /// The windows of the weak form of these rows, where there are to be any.
    ///
    /// # Errors
    /// Those of reading; requested windows that are impossible.
    pub fn windows_for(
        &self,
        form: WeakForm,
        source: &dyn Source,
        notes: &mut Vec<String>,
    ) -> Result<Option<Windows>, Error> {
        let longest = source.episodes().iter().max_by_key(|episode| episode.rows);
        let room = longest.map_or(0, |episode| episode.rows);
        let known = self.differences().next().is_some();
        if !known && matches!(form, WeakForm::Auto | WeakForm::Rows(_)) {
            return Err(RecipeError::conflict(
                format!("{WEAK} moves the derivatives of states onto test functions, and no equation has a derivative by central differences: remove it, or write \
                 `derivative = \"auto\"` ({STATES_SECTION})"),
            )
.into());
        }
        let noise = if known && form != WeakForm::Off { self.noise(source)? } else { None };
        let reach = match form {
            WeakForm::Off => return Ok(None),
            WeakForm::ByNoise if noise.as_ref().is_none_or(|(_, share)| *share <= NOISE) => return Ok(None),
            WeakForm::ByNoise | WeakForm::Auto => self.reach(source)?.min(room / ROOM),
            WeakForm::Rows(rows) => rows / 2,
        };
        let rows = 2 * reach.max(LEAST_REACH) + 1;
        if reach < LEAST_REACH && form == WeakForm::ByNoise {
            return Ok(None);
        }
        if room < rows || reach < LEAST_REACH {
            let name = longest.map_or("none", |episode| episode.name.as_str());
            let needed = if reach < LEAST_REACH { ROOM * LEAST_REACH } else { rows };
            return Err(RecipeError::too_few_rows(
                room as u64,
                needed as u64,
                format!(
                    "{WEAK}: windows of {rows} rows need an episode of {needed} rows or more, and the longest, {name}, has {room}: give longer episodes, a smaller number of \
                     rows, or remove {WEAK}"
                ),
            )
.into());
        }
        let short: Vec<&str> =
            source.episodes().iter().filter(|one| one.rows < rows).map(|one| one.name.as_str()).collect();
        if let Some(first) = short.first() {
            notes.push(format!(
                "{} of {} episodes (the first is {first}) are shorter than a window of {rows} rows and left out; a smaller number of rows ({WEAK}) takes them in",
                short.len(),
                source.episodes().len()
            ));
        }
        let accuracy = weak_accuracy(reach, source)?.max(ACCURACY);
        Ok(Some(Windows { reach, accuracy, noise }))
    }

    /// The equations whose left sides are central differences, and their arguments.
    fn differences(&self) -> impl Iterator<Item = (&FittedEquation, &CentralDifference)> {
        self.fitted.iter().filter_map(|equation| Some((equation, &equation.central.as_ref()?.form)))
    }

    /// The left side whose differences noise hits hardest, and the share of their variance that is noise.
    fn noise(&self, source: &dyn Source) -> Result<Option<(String, f64)>, Error> {
        let measured: Vec<Expr> = self.differences().map(|(equation, _)| equation.measured.clone()).collect();
        let share = |((equation, _), variance): ((&FittedEquation, _), f64)| {
            let noise = equation.central.as_ref()?.errors?.noise;
            let share = if variance > 0.0 { (noise * noise / variance).min(1.0) } else { 0.0 };
            Some((equation.label.clone(), share))
        };
        let shares = self.differences().zip(sampled_variances(&measured, source)?).filter_map(share);
        Ok(shares.max_by(|a, b| a.1.total_cmp(&b.1)))
    }

    /// Rows from the middle of a window to its end. They are as many as the fastest state takes to change by its
    /// spread, without noise, which is a sixth of the period of a wave. The test function, much narrower than the
    /// window, then passes the frequencies of the states, and stops those above. Windows of one and a half times that
    /// length leave too little of a wave's harmonics to distinguish a cube from the wave itself.
    fn reach(&self, source: &dyn Source) -> Result<usize, Error> {
        let signals: Vec<Expr> =
            self.differences().map(|(_, form)| if form.angle { form.of.sin() } else { form.of.clone() }).collect();
        let noise: Vec<Expr> = signals.iter().map(noise_of_a_row).collect();
        let noise = sampled_mean_squares(&noise, source)?;
        let variances = sampled_variances(&signals, source)?;
        let spread = |at: usize| variances[at] - noise[at];
        let mut before = vec![0.0; signals.len()];
        for (k, lag) in LAGS.into_iter().enumerate() {
            let changes: Vec<Expr> = signals.iter().map(|signal| signal - signal.shifted(lag)).collect();
            let mut changes = sampled_mean_squares(&changes, source)?;
            changes.iter_mut().zip(&noise).for_each(|(change, noise)| *change -= 2.0 * noise);
            let crossed = |at: usize| {
                let (low, high, goal) = (before[at], changes[at], spread(at));
                let from = if k == 0 { 0 } else { LAGS[k - 1] };
                let share = ((goal - low) / (high - low)).clamp(0.0, 1.0);
                (goal > noise[at] && high >= goal).then(|| f64::from(from) + share * f64::from(lag - from))
            };
            if let Some(least) = (0..signals.len()).filter_map(crossed).min_by(f64::total_cmp) {
                return Ok(least.round().max(LEAST_REACH as f64) as usize);
            }
            before = changes;
        }
        Ok(LAGS[LAGS.len() - 1] as usize)
    }

    /// Sums over windows.
    pub(crate) fn weak(&self, windows: &Windows) -> Weak {
        let target = |equation: &FittedEquation| match &equation.central {
            None => WeakTarget { rate: None, mean: equation.target.clone() },
            Some(central) => WeakTarget {
                rate: Some(Rate { of: central.form.of.clone(), angle: central.form.angle }),
                mean: equation.nominal.as_ref().map_or(Expr::number(0.0), |nominal| -nominal),
            },
        };
        let targets = self.fitted.iter().map(target).collect();
        Weak { reach: windows.reach, targets, accuracy: windows.accuracy }
    }
}

/// The noise of a row of a signal: its mean square is that of the noise, where it is white.
fn noise_of_a_row(of: &Expr) -> Expr {
    let form = CentralDifference { of: of.clone(), angle: false, reach: 1, spacing: Spacing::Stamps };
    form.noise_of_a_sample()
}
