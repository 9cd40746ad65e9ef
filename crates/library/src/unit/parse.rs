//! Units from text.

use fleetfoot_data::nearest;

use super::{Unit, UnitError, symbols};

/// Parentheses inside each other.
const MAX_DEPTH: usize = 50;

pub(super) fn unit(text: &str) -> Result<Unit, UnitError> {
    if matches!(text.trim(), "" | "-" | "1") {
        return Ok(Unit::one());
    }
    let mut parser = Parser { text, at: 0, depth: 0 };
    let unit = parser.product()?;
    match parser.peek() {
        None => Ok(unit),
        Some(_) => Err(parser.expected("`*`, `/`, `^` or the end")),
    }
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
}

impl Parser<'_> {
    fn product(&mut self) -> Result<Unit, UnitError> {
        let mut unit = self.power()?;
        loop {
            match self.peek() {
                Some('*' | '·' | '⋅') => {
                    self.skip();
                    unit = unit.times(&self.power()?);
                }
                Some('/') => {
                    self.skip();
                    unit = unit.per(&self.power()?);
                }
                // A space multiplies.
                Some(c) if c.is_alphabetic() || matches!(c, '°' | '%' | '(') => unit = unit.times(&self.power()?),
                _ => return Ok(unit),
            }
        }
    }

    /// A name or parentheses, with an exponent.
    fn power(&mut self) -> Result<Unit, UnitError> {
        let base = match self.peek() {
            Some('(') if self.depth < MAX_DEPTH => {
                self.skip();
                self.depth += 1;
                let inner = self.product()?;
                self.depth -= 1;
                self.close()?;
                inner
            }
            Some('1') => {
                self.skip();
                Unit::one()
            }
            Some(_) => self.name()?,
            None => return Err(self.expected("a unit")),
        };
        let start = self.at;
        let exponent = self.exponent()?;
        base.power(exponent).ok_or_else(|| {
            self.at = start;
            self.expected("an exponent that is a multiple of 1/12")
        })
    }

    fn name(&mut self) -> Result<Unit, UnitError> {
        let rest = &self.text[self.at..];
        let is_part = |(i, c): (usize, char)| {
            let letter = c.is_alphabetic() || matches!(c, '_' | '°' | '%');
            letter || (c.is_ascii_digit() && i > 0)
        };
        let length = rest.char_indices().find(|&part| !is_part(part)).map_or(rest.len(), |(i, _)| i);
        let name = &rest[..length];
        if name.is_empty() {
            return Err(self.expected("a unit"));
        }
        let Some((scale, dimension)) = symbols::find(name) else {
            let nearest = nearest(name, symbols::names());
            return Err(UnitError::Unknown { text: self.text.to_owned(), symbol: name.to_owned(), nearest });
        };
        self.at += length;
        Ok(Unit { symbols: vec![(name.to_owned(), super::WHOLE)], dimension, scale })
    }

    /// `^2`, `**2`, `^-1`, `^0.5`, `^(1/2)`, `²`; 1 where there is none.
    fn exponent(&mut self) -> Result<f64, UnitError> {
        let rest = &self.text[self.at..];
        let digit = |c: char| "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().position(|known| known == c);
        let mut characters = rest.chars();
        let (sign, first) = match characters.next() {
            Some('⁻') => (-1.0, characters.next()),
            first => (1.0, first),
        };
        if let Some(digit) = first.and_then(digit) {
            self.at = self.text.len() - characters.as_str().len();
            return Ok(sign * digit as f64);
        }
        if rest.starts_with("**") {
            self.at += 2;
        } else if self.peek() == Some('^') {
            self.skip();
        } else {
            return Ok(1.0);
        }
        if self.peek() != Some('(') {
            return self.number();
        }
        self.skip();
        let mut value = self.number()?;
        if self.peek() == Some('/') {
            self.skip();
            value /= self.number()?;
        }
        self.close()?;
        Ok(value)
    }

    fn number(&mut self) -> Result<f64, UnitError> {
        self.peek();
        let rest = &self.text[self.at..];
        let sign = usize::from(rest.starts_with(['-', '+']));
        let length =
            rest[sign..].find(|c: char| !(c.is_ascii_digit() || c == '.')).map_or(rest.len(), |end| sign + end);
        match rest[..length].parse() {
            Ok(value) => {
                self.at += length;
                Ok(value)
            }
            Err(_) => Err(self.expected("a number")),
        }
    }

    fn close(&mut self) -> Result<(), UnitError> {
        if self.peek() != Some(')') {
            return Err(self.expected("`)`"));
        }
        self.skip();
        Ok(())
    }

    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
        self.text[self.at..].chars().next()
    }

    fn skip(&mut self) {
        self.at += self.text[self.at..].chars().next().map_or(0, char::len_utf8);
    }

    fn expected(&self, expected: &'static str) -> UnitError {
        UnitError::Syntax { text: self.text.to_owned(), position: self.at, expected }
    }
}
