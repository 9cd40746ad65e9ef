//! The sizes and the names that all pieces of a filter are written with.

use fleetfoot_control::filter::FilterTables;
use fleetfoot_model::Model;

use crate::{c_syntax::C, print::Syntax, writer::Writer};

/// A filter that is written in C; its fields of one letter are those of the formulas.
pub(super) struct Filter<'a> {
    pub(super) c: C<'a>,
    pub(super) tables: &'a FilterTables,
    pub(super) model: &'a Model,
    /// Places of the code's inputs among those of the tables.
    pub(super) inputs: Vec<usize>,
    /// True if the state decides the region.
    pub(super) by_state: bool,
    /// True if a table of probabilities decides the next region.
    pub(super) switches: bool,
    /// The prefix of all names.
    pub(super) p: &'a str,
    /// The type of real numbers.
    pub(super) t: &'static str,
    /// Zero as such a number.
    pub(super) zero: String,
    /// The largest such number.
    pub(super) max: &'static str,
    /// States.
    pub(super) n: usize,
    /// Entries of their covariance.
    pub(super) nn: usize,
    /// Inputs.
    pub(super) m: usize,
    /// Regions.
    pub(super) r: usize,
    /// Residuals of a row in the correlated noise.
    pub(super) q: usize,
    /// Those of all rows that are kept, behind the states.
    pub(super) behind: usize,
    /// States and residuals.
    pub(super) all: usize,
    /// Entries of their covariance.
    pub(super) square: usize,
    pub(super) sensors: usize,
    /// Points of a distribution.
    pub(super) points: usize,
}

impl<'a> Filter<'a> {
    /// `inputs`: places of the code's inputs among those of the tables.
    pub(super) fn new(c: C<'a>, model: &'a Model, tables: &'a FilterTables, inputs: Vec<usize>) -> Self {
        let (n, r) = (tables.states.len(), tables.regions.len());
        let colour = tables.colour.as_ref();
        let q = colour.map_or(0, |colour| colour.innovation.len().isqrt());
        let behind = colour.map_or(0, |colour| colour.stationary.len().isqrt());
        let all = n + behind;
        Self {
            p: c.prefix,
            t: c.real(),
            zero: c.number(0.0),
            max: c.largest(),
            m: inputs.len(),
            by_state: tables.transitions.is_none() && r > 1,
            switches: tables.transitions.is_some() && r > 1,
            nn: n * n,
            square: all * all,
            sensors: tables.sensors.len(),
            points: tables.points.len() / n.max(1),
            c,
            tables,
            model,
            inputs,
            n,
            r,
            q,
            behind,
            all,
        }
    }

    /// The parameter of the inputs, where there are any.
    pub(super) fn u_parameter(&self) -> String {
        match self.m {
            0 => String::new(),
            m => format!(", const {} u[{m}]", self.t),
        }
    }

    /// The argument of the inputs, where there are any.
    pub(super) fn given(&self, inputs: &str) -> String {
        if self.m > 0 { format!(", {inputs}") } else { String::new() }
    }

    /// The C test that a value is finite.
    pub(super) fn finite(&self, value: &str) -> String {
        format!("{value} >= -{max} && {value} <= {max}", max = self.max)
    }

    /// Takes the value of a state within half a turn, where the state is an angle.
    pub(super) fn wrap(&self, w: &mut Writer, state: &str, value: &str) {
        let p = self.p;
        for (angle, _) in self.tables.angles.iter().enumerate().filter(|(_, angle)| **angle) {
            w.block(format_args!("if ({state} == {angle})"), |w| {
                writeln!(w, "{value} = {p}_wrap_({value});");
            });
        }
    }
}
