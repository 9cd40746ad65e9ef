//! `[network]`: feed-forward and recurrent networks beside a linear map.

use std::{
    fmt::{self, Display, Formatter},
    str::FromStr,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{bounds::whole, narx::Effort, settings::settings};

/// Activation function of a network's hidden units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum ActivationWord {
    /// tanh(z).
    #[default]
    Tanh,
    /// max(z, 0).
    Relu,
    /// log(1 + exp(z)).
    Softplus,
}

/// Recurrent cell in place of hidden layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum CellWord {
    /// Hidden layers.
    #[default]
    None,
    /// Recurrent network with tanh.
    Rnn,
    /// Gated recurrent unit.
    Gru,
    /// Long short-term memory.
    Lstm,
}

/// Most units of a layer, and most layers.
const MOST: (usize, usize) = (1_024, 8);

/// `64,64`: units of every hidden layer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
pub struct HiddenLayers(pub Vec<usize>);

impl FromStr for HiddenLayers {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let layer = |item: &str| item.trim().parse().ok().filter(|units| (1..=MOST.0).contains(units));
        let widths: Option<Vec<usize>> = text.split(',').map(layer).collect();
        widths.filter(|layers| layers.len() <= MOST.1).map(Self).ok_or_else(|| {
            format!(
                "hidden = \"{text}\": write the units of every hidden layer with commas, such as 32,32; 1 to {} units, {} layers at most",
                MOST.0, MOST.1
            )
        })
    }
}

impl Display for HiddenLayers {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let layers: Vec<String> = self.0.iter().map(usize::to_string).collect();
        f.write_str(&layers.join(","))
    }
}

impl TryFrom<String> for HiddenLayers {
    type Error = String;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl From<HiddenLayers> for String {
    fn from(layers: HiddenLayers) -> Self {
        layers.to_string()
    }
}

settings! {
    network, |_, _| {};
    /// Training and choice of a network. Every entry is the flag of `fit network` of the same name.
    pub struct NetworkSection {
        /// Units of every hidden layer, with commas (default: sizes from small to large, chosen by held-out rows).
        #[arg(long, value_name = "UNITS")]
        pub hidden: HiddenLayers,
        /// Activation function of the hidden units (default: tanh).
        #[arg(long, value_enum, value_name = "FUNCTION")]
        pub activation: ActivationWord,
        /// Recurrent cell that reads the past rows one after another, in place of hidden layers (default: none).
        #[arg(long, value_enum, value_name = "CELL")]
        pub cell: CellWord,
        /// Search effort, a count of work, never of seconds (default: normal).
        #[arg(long, value_enum, value_name = "EFFORT")]
        pub effort: Effort,
        /// Folds of the cross-validation: whole episodes if there are enough, else spans (default: 5).
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=100))]
        pub folds: u16,
        /// Seed of all random numbers (default: 0).
        #[arg(long, value_name = "SEED")]
        pub seed: u64,
        /// Memory for the rows that train; of more rows an even share is taken (default: 512).
        #[arg(long, value_name = "MiB", value_parser = whole::<usize>(1..=1_000_000))]
        pub memory: usize,
    }
}
