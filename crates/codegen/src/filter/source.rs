//! The source of a filter: tables, the region of a state, then the pieces of the filter in their order.

use super::sizes::Filter;
use crate::{code::Code, cost::Used, writer::Writer};

/// A function of the filter.
type Piece<'a> = fn(&Filter<'a>, &mut Writer);

impl<'a> Filter<'a> {
    pub(super) fn source(&self, code: &Code) -> String {
        let mut used = Used::of(code);
        if self.tables.angles.contains(&true) {
            used.unary.insert(fleetfoot_library::Unary::Wrap);
        }
        let p = self.p;
        let mut out = format!(
            "/* See {p}.h. */\n#include \"{p}.h\"\n\n#include <float.h>\n#include <math.h>\n#include <stdbool.h>\n#include <stddef.h>\n\n"
        );
        if self.by_state {
            let upper = self.c.upper();
            out += &format!("enum {{ {upper}_NO_REGION = -32767, {upper}_NOT_FINITE = -32766 }};\n\n");
        }
        self.c.helpers(&used, &mut out);
        self.c.code(code, &mut out);
        let mut w = Writer::default();
        self.functions(&mut w);
        out + &w.into_text()
    }

    /// The functions, in an order in which each calls earlier ones only.
    fn functions(&self, w: &mut Writer) {
        let apart = |w: &mut Writer, pieces: &[Piece<'a>]| {
            for piece in pieces {
                piece(self, w);
                w.blank();
            }
        };
        if self.by_state {
            apart(w, &[Self::factor, Self::offset, Self::place, Self::went, Self::part]);
        }
        apart(w, &[Self::mixture, Self::likely]);
        if self.by_state || self.switches {
            apart(w, &[Self::take_over]);
        }
        if self.by_state {
            self.remember(w);
            self.join(w);
        }
        apart(w, &[Self::predict, Self::observe]);
        if self.by_state {
            self.mass(w);
        }
        apart(w, &[Self::estimate, Self::start]);
        self.step(w);
    }
}
