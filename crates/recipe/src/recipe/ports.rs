//! Ports at which a model exchanges energy.

use std::{
    fmt::{self, Display, Formatter},
    str::FromStr,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Port: an input, and the state whose product with it is a power.
#[derive(Debug, Clone, PartialEq)]
pub struct Port {
    /// Input.
    pub input: String,
    /// State whose product with the input is a power.
    pub output: String,
    /// Allowed energy gain per sample, in units of the state over those of the input; `None`: by the discretisation
    /// error.
    pub shortage: Option<f64>,
}

/// `f:v`, `f:v:0.05, tau:w`: ports, each with an optional energy gain per sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
pub struct PortList(pub Vec<Port>);

impl FromStr for PortList {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let port = |item: &str| {
            let mut parts = item.split(':').map(str::trim);
            let named = |part: Option<&str>| part.filter(|name| !name.is_empty()).map(str::to_owned);
            let mut port = Port { input: named(parts.next())?, output: named(parts.next())?, shortage: None };
            if let Some(number) = parts.next() {
                port.shortage = Some(number.parse().ok().filter(|value: &f64| *value > 0.0 && value.is_finite())?);
            }
            parts.next().is_none().then_some(port)
        };
        let ports: Option<Vec<Port>> = text.split(',').map(port).collect();
        ports.map(Self).ok_or_else(|| {
            format!(
                "passive = \"{text}\": write INPUT:STATE, such as force:speed, several with commas; INPUT:STATE:SHORTAGE also sets the allowed energy gain per sample, a number \
                 above 0"
            )
        })
    }
}

impl Display for PortList {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (at, port) in self.0.iter().enumerate() {
            let comma = if at > 0 { "," } else { "" };
            write!(f, "{comma}{}:{}", port.input, port.output)?;
            if let Some(shortage) = port.shortage {
                write!(f, ":{shortage}")?;
            }
        }
        Ok(())
    }
}

impl TryFrom<String> for PortList {
    type Error = String;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl From<PortList> for String {
    fn from(ports: PortList) -> Self {
        ports.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_and_written() {
        for (text, again) in [("f:v", "f:v"), (" f : v:0.05 , tau:w", "f:v:0.05,tau:w")] {
            let ports: PortList = text.parse().unwrap();
            assert_eq!((ports.to_string().as_str(), again.parse()), (again, Ok(ports)));
        }
        let ports: PortList = "f:v:0.05".parse().unwrap();
        assert_eq!((&*ports.0[0].input, &*ports.0[0].output, ports.0[0].shortage), ("f", "v", Some(0.05)));
        for text in ["", "f", "f:", ":v", "f:v:0", "f:v:-1", "f:v:x", "f:v:1:2", "f:v,"] {
            let error = text.parse::<PortList>().unwrap_err();
            assert!(error.contains("force:speed"), "{text}: {error}");
        }
    }
}
