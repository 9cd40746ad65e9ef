//! Options of a preparation: the settings of `[prepare]` and `[channels.NAME]`, checked once.

use fleetfoot_data::setting::PREPARE_SECTION;
use fleetfoot_data::{did_you_mean, nearest};
use fleetfoot_dataset::Error;
use fleetfoot_recipe::{Limits, PrepareMethod, PrepareSection, Recipe, Settings, Tunable};
use fleetfoot_signal::{Interpolation, Lambda, Spline};

/// Method that smooths a channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Method {
    /// The better of the two smoothing splines.
    Auto(Lambda),
    Spline(Spline, Lambda),
    Trend {
        degree: usize,
        lambda: Lambda,
    },
    Interpolate(Interpolation),
    SavitzkyGolay {
        window: usize,
        degree: usize,
    },
    Butterworth {
        order: usize,
        cutoff: f64,
    },
    None,
}

/// Options of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ChannelOptions {
    pub(crate) method: Method,
    pub(crate) second_order: bool,
    /// Standard deviations; `None`: nothing is rejected.
    pub(crate) reject: Option<f64>,
    pub(crate) hampel: usize,
    pub(crate) stuck: usize,
    pub(crate) range: Option<[f64; 2]>,
    pub(crate) bounds: Option<[f64; 2]>,
    /// Delay of the stamps behind the measurements, seconds.
    pub(crate) late: f64,
}

impl Method {
    /// Number of derivatives that it gives beside the value.
    pub(crate) fn rates(self) -> usize {
        match self {
            Self::None => 0,
            Self::Auto(_) => Spline::Cubic.states() - 1,
            Self::Spline(spline, _) => spline.states() - 1,
            Self::Trend { degree: 1, .. } | Self::Interpolate(Interpolation::ShapePreserving) => 1,
            Self::Trend { .. } | Self::Interpolate(_) | Self::SavitzkyGolay { .. } | Self::Butterworth { .. } => 2,
        }
    }

    /// Returns true for a smoothing spline, which gives standard deviations.
    pub(crate) fn is_smoothing(self) -> bool {
        matches!(self, Self::Auto(_) | Self::Spline(..))
    }

    /// Its word in a recipe.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Auto(_) => "auto",
            Self::Spline(Spline::Cubic, _) => "cubic",
            Self::Spline(Spline::Quintic, _) => "quintic",
            Self::Trend { .. } => "trend-filter",
            Self::Interpolate(Interpolation::NotAKnot) => "not-a-knot",
            Self::Interpolate(Interpolation::ShapePreserving) => "pchip",
            Self::SavitzkyGolay { .. } => "savitzky-golay",
            Self::Butterworth { .. } => "butterworth",
            Self::None => "none",
        }
    }
}

/// Options of whole episodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EpisodeOptions {
    pub(crate) clip: f64,
    pub(crate) dejitter: bool,
    pub(crate) decimate: usize,
    pub(crate) min_rows: usize,
}

/// Settings of whole episodes.
const OF_EPISODES: [&str; 4] = ["clip", "dejitter", "decimate", "min_rows"];

fn refused(channel: Option<&str>, what: &str, value: impl std::fmt::Display, allowed: &str) -> Error {
    Error::value(format!("{}: write {allowed}", entry(channel, what, value)))
}

/// An entry of `[channels.NAME]`, else of `[prepare]`.
fn entry(channel: Option<&str>, what: &str, value: impl std::fmt::Display) -> String {
    match channel {
        Some(name) => format!("[channels.{name}] {what} = {value}"),
        None => PREPARE_SECTION.entry(what).is(value).to_string(),
    }
}

fn checked<T: std::fmt::Display + Copy>(
    channel: Option<&str>,
    what: &str,
    value: T,
    holds: impl Fn(T) -> bool,
    allowed: &str,
) -> Result<T, Error> {
    if holds(value) { Ok(value) } else { Err(refused(channel, what, value, allowed)) }
}

impl EpisodeOptions {
    /// Reads `[prepare]`.
    pub(crate) fn new(section: &PrepareSection) -> Result<Self, Error> {
        let is_time = |seconds: f64| seconds >= 0.0 && seconds.is_finite();
        let clip = checked(None, "clip", section.clip.unwrap_or(0.0), is_time, "seconds, zero or more")?;
        let decimate =
            checked(None, "decimate", section.decimate.unwrap_or(1), |n| n > 0, "a number of rows from 1 on")?;
        let dejitter = section.dejitter.unwrap_or(false);
        Ok(Self { clip, dejitter, decimate, min_rows: section.min_rows.unwrap_or(50).max(2) })
    }
}

impl ChannelOptions {
    /// Options of a state or an input: those of `[channels.NAME]`, else, for a state, those of `[prepare]`.
    pub(crate) fn new(recipe: &Recipe, name: &str, is_state: bool) -> Result<Self, Error> {
        let (channel, section) = match recipe.channels.get(name) {
            None if is_state => (None, recipe.prepare.clone()),
            None => (None, PrepareSection::default()),
            Some(channel) => (Some(name), channel.clone().over(recipe.prepare.clone())),
        };
        let says = recipe.channels.get(name).is_some_and(|channel| channel.method.is_some());
        let second_order = is_state && section.second_order.unwrap_or(false);
        let method = match section.method {
            _ if !is_state && !says => PrepareMethod::None,
            None if second_order => PrepareMethod::Quintic,
            // A penalty is one of s^3 or of s^5.
            None if matches!(section.lambda, Some(Tunable::Number(_))) => PrepareMethod::Cubic,
            None => PrepareMethod::Auto,
            Some(method) => method,
        };
        Self::read(channel, &section, method, second_order)
    }

    fn read(
        channel: Option<&str>,
        section: &PrepareSection,
        method: PrepareMethod,
        second_order: bool,
    ) -> Result<Self, Error> {
        let method = read_method(channel, section, method)?;
        if second_order && method.rates() < 2 {
            let allowed = "quintic, trend-filter of degree 2 or 3, not-a-knot, savitzky-golay or butterworth, as second_order needs an acceleration";
            return Err(refused(channel, "method", method.word(), allowed));
        }
        let by_default = if method.is_smoothing() { 4.0 } else { 0.0 };
        let is_number = |sigmas: f64| sigmas >= 0.0 && sigmas.is_finite();
        let allowed = "a number of standard deviations, zero for none";
        let reject = checked(channel, "reject", section.reject.unwrap_or(by_default), is_number, allowed)?;
        let limits = |what, limits: Option<Limits>| match limits {
            Some(Limits([low, high])) if low.is_nan() || high.is_nan() || low >= high => {
                Err(refused(channel, what, format!("[{low}, {high}]"), "a least and a greatest value"))
            }
            limits => Ok(limits.map(|limits| limits.0)),
        };
        Ok(Self {
            method,
            second_order,
            reject: Some(reject).filter(|&sigmas| sigmas > 0.0 && method != Method::None),
            hampel: section.hampel.unwrap_or(0),
            stuck: section.stuck.unwrap_or(0),
            range: limits("range", section.range)?,
            bounds: limits("bounds", section.bounds)?,
            late: late(channel, section)?,
        })
    }
}

/// Half of a mean's window, and the delay.
fn late(channel: Option<&str>, section: &PrepareSection) -> Result<f64, Error> {
    let is_window = |seconds: f64| seconds >= 0.0 && seconds.is_finite();
    let window = checked(channel, "average", section.average.unwrap_or(0.0), is_window, "seconds, zero or more")?;
    let delay = checked(channel, "delay", section.delay.unwrap_or(0.0), |seconds: f64| seconds.is_finite(), "seconds")?;
    Ok(delay + 0.5 * window)
}

fn read_method(channel: Option<&str>, section: &PrepareSection, method: PrepareMethod) -> Result<Method, Error> {
    Ok(match method {
        PrepareMethod::Auto => match lambda(channel, section)? {
            Lambda::Given(lambda) => {
                let allowed = "likelihood or gcv with method = \"auto\", or name the spline of this penalty: method = \"cubic\" (s^3) or \"quintic\" (s^5)";
                return Err(refused(channel, "lambda", lambda, allowed));
            }
            by => Method::Auto(by),
        },
        PrepareMethod::Cubic => Method::Spline(Spline::Cubic, lambda(channel, section)?),
        PrepareMethod::Quintic => Method::Spline(Spline::Quintic, lambda(channel, section)?),
        PrepareMethod::None => Method::None,
        PrepareMethod::NotAKnot => Method::Interpolate(Interpolation::NotAKnot),
        PrepareMethod::Pchip => Method::Interpolate(Interpolation::ShapePreserving),
        PrepareMethod::TrendFilter => {
            let is_degree = |degree: usize| (1..=3).contains(&degree);
            let degree = checked(channel, "degree", section.degree.unwrap_or(2), is_degree, "1, 2 or 3")?;
            Method::Trend { degree, lambda: lambda(channel, section)? }
        }
        PrepareMethod::SavitzkyGolay => {
            let odd = |rows: usize| rows % 2 == 1 && rows >= 3;
            let window =
                checked(channel, "window", section.window.unwrap_or(11), odd, "an odd number of rows from 3 on")?;
            let fits = |degree: usize| (2..window).contains(&degree);
            let degree =
                checked(channel, "degree", section.degree.unwrap_or(3), fits, "2 or more, less than the window")?;
            Method::SavitzkyGolay { window, degree }
        }
        PrepareMethod::Butterworth => {
            let Some(cutoff) = section.cutoff else {
                return Err(Error::missing(format!(
                    "{}: give a cut-off too, `cutoff = 20.0` in Hz",
                    entry(channel, "method", "\"butterworth\"")
                )));
            };
            let is_rate = |hertz: f64| hertz > 0.0 && hertz.is_finite();
            let cutoff = checked(channel, "cutoff", cutoff, is_rate, "a frequency in Hz above 0")?;
            let order = checked(channel, "order", section.order.unwrap_or(4), |n| (1..=20).contains(&n), "1 to 20")?;
            Method::Butterworth { order, cutoff }
        }
    })
}

fn lambda(channel: Option<&str>, section: &PrepareSection) -> Result<Lambda, Error> {
    match &section.lambda {
        None => Ok(Lambda::Likelihood),
        Some(Tunable::Number(lambda)) if *lambda > 0.0 && lambda.is_finite() => Ok(Lambda::Given(*lambda)),
        Some(Tunable::Word(word)) if word == "likelihood" => Ok(Lambda::Likelihood),
        Some(Tunable::Word(word)) if word == "gcv" => Ok(Lambda::Gcv),
        Some(other) => Err(refused(channel, "lambda", other, "a penalty above 0, likelihood or gcv")),
    }
}

/// Refuses `[channels.NAME]` of a name that is no state and no input, and settings of whole episodes there.
pub(crate) fn check_channels(recipe: &Recipe) -> Result<(), Error> {
    for (name, channel) in &recipe.channels {
        let names = || recipe.states.keys().chain(recipe.inputs.keys()).map(String::as_str);
        if !names().any(|known| known == name) {
            let mend = did_you_mean(&nearest(name, names()));
            return Err(Error::unknown(
                name,
                format!("[channels.{name}]: `{name}` is neither a state nor an input{mend}"),
            ));
        }
        let is_set = [
            channel.clip.is_some(),
            channel.dejitter.is_some(),
            channel.decimate.is_some(),
            channel.min_rows.is_some(),
        ];
        if let Some(at) = is_set.iter().position(|&is_set| is_set) {
            let entry = OF_EPISODES[at];
            return Err(Error::conflict(format!(
                "[channels.{name}] {entry}: it applies to whole episodes; write it in {PREPARE_SECTION}"
            )));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(text: &str, name: &str) -> Result<ChannelOptions, String> {
        let text = format!("[states]\nq = {{}}\n[inputs]\nu = \"u\"\n{text}");
        let recipe = Recipe::parse(&text, "test").map_err(|error| error.to_string())?;
        ChannelOptions::new(&recipe, name, name == "q").map_err(|error| error.to_string())
    }

    #[test]
    fn channels_override_the_section() {
        let default = options("", "q").unwrap();
        assert_eq!(default.method, Method::Auto(Lambda::Likelihood));
        assert_eq!((default.reject, default.second_order, default.range), (Some(4.0), false, None));
        let section = "[prepare]\nsecond_order = true\nlambda = \"gcv\"\nreject = 0.0\nrange = [-1.0, 1.0]\n";
        let merged = options(section, "q").unwrap();
        assert_eq!(merged.method, Method::Spline(Spline::Quintic, Lambda::Gcv));
        assert_eq!((merged.reject, merged.second_order, merged.range), (None, true, Some([-1.0, 1.0])));
        assert_eq!(options(section, "u").unwrap().method, Method::None);
        let channels =
            format!("{section}[channels.u]\nmethod = \"butterworth\"\ncutoff = 3.0\n[channels.q]\nlambda = 2.5\n");
        let input = options(&channels, "u").unwrap();
        assert_eq!((input.method, input.second_order), (Method::Butterworth { order: 4, cutoff: 3.0 }, false));
        assert_eq!(options(&channels, "q").unwrap().method, Method::Spline(Spline::Quintic, Lambda::Given(2.5)));
        let way = |text: &str| options(text, "q").unwrap().method;
        assert_eq!(way("[prepare]\nlambda = \"gcv\"\n"), Method::Auto(Lambda::Gcv));
        assert_eq!(way("[prepare]\nlambda = 2.5\n"), Method::Spline(Spline::Cubic, Lambda::Given(2.5)));
        assert_eq!(way("[prepare]\nmethod = \"pchip\"\n"), Method::Interpolate(Interpolation::ShapePreserving));
        let trend = way("[prepare]\nmethod = \"trend-filter\"\nlambda = \"gcv\"\n");
        assert_eq!(trend, Method::Trend { degree: 2, lambda: Lambda::Gcv });
        assert_eq!(options("[channels.q]\ndelay = 0.01\naverage = 0.02\n", "q").unwrap().late, 0.02);
        // A range is no reason to smooth an input.
        assert_eq!(options("[channels.u]\nrange = [0.0, 1.0]\n", "u").unwrap().method, Method::None);
    }

    #[test]
    fn bad_options_are_refused_with_their_place() {
        for (text, words) in [
            ("[prepare]\nmethod = \"savitzky-golay\"\nwindow = 8\n", ["[prepare] window = 8", "odd"]),
            (
                "[channels.q]\nmethod = \"savitzky-golay\"\nwindow = 5\ndegree = 5\n",
                ["[channels.q] degree = 5", "window"],
            ),
            ("[prepare]\nmethod = \"butterworth\"\n", ["cutoff", "Hz"]),
            ("[prepare]\nlambda = 0.0\n", ["lambda = 0", "gcv"]),
            ("[prepare]\nmethod = \"auto\"\nlambda = 2.5\n", ["lambda = 2.5", "s^5"]),
            ("[prepare]\nmethod = \"auto\"\nsecond_order = true\n", ["method = auto", "quintic"]),
            ("[prepare]\nreject = -1.0\n", ["reject = -1", "zero for none"]),
            ("[prepare]\nbounds = [2.0, 1.0]\n", ["bounds = [2, 1]", "least"]),
            ("[prepare]\nmethod = \"cubic\"\nsecond_order = true\n", ["method = cubic", "acceleration"]),
            ("[prepare]\nmethod = \"pchip\"\nsecond_order = true\n", ["method = pchip", "acceleration"]),
            (
                "[prepare]\nmethod = \"trend-filter\"\ndegree = 1\nsecond_order = true\n",
                ["method = trend-filter", "degree 2 or 3"],
            ),
            ("[prepare]\nmethod = \"trend-filter\"\ndegree = 4\n", ["[prepare] degree = 4", "1, 2 or 3"]),
            ("[channels.q]\naverage = -0.1\n", ["[channels.q] average = -0.1", "zero or more"]),
        ] {
            let error = options(text, "q").unwrap_err();
            assert!(words.iter().all(|word| error.contains(word)), "{text}: {error}");
        }
        assert_eq!("-1.5:2".parse(), Ok(Limits([-1.5, 2.0])));
        assert!("3".parse::<Limits>().is_err() && "a:2".parse::<Limits>().is_err());
    }
}
