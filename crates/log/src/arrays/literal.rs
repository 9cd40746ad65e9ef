//! The literals of Python in the head of a NumPy array.

/// A literal.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Literal {
    Text(String),
    Whole(usize),
    Bool(bool),
    /// A tuple or a list.
    Many(Vec<Literal>),
    Map(Vec<(Literal, Literal)>),
    None,
}

/// Literals inside each other.
const MAX_DEPTH: usize = 32;

impl Literal {
    /// Reads the literal at the beginning of a text.
    pub(super) fn parse(text: &str) -> Option<Self> {
        Parser { rest: text }.literal(0)
    }

    pub(super) fn text(&self) -> Option<&str> {
        if let Self::Text(text) = self { Some(text) } else { None }
    }

    pub(super) fn many(&self) -> Option<&[Self]> {
        if let Self::Many(all) = self { Some(all) } else { None }
    }

    /// Dimensions.
    pub(super) fn shape(&self) -> Option<Vec<usize>> {
        let whole = |whole_value: &Self| if let Self::Whole(value) = whole_value { Some(*value) } else { None };
        match self {
            Self::Whole(value) => Some(vec![*value]),
            Self::Many(all) => all.iter().map(whole).collect(),
            _ => None,
        }
    }

    /// The value of a key.
    pub(super) fn get(&self, key: &str) -> Option<&Self> {
        let Self::Map(all) = self else { return None };
        all.iter().find(|(name, _)| name.text() == Some(key)).map(|(_, value)| value)
    }
}

struct Parser<'a> {
    rest: &'a str,
}

impl Parser<'_> {
    fn take(&mut self, sign: char) -> bool {
        self.rest = self.rest.trim_start();
        match self.rest.strip_prefix(sign) {
            Some(rest) => {
                self.rest = rest;
                true
            }
            None => false,
        }
    }

    fn literal(&mut self, depth: usize) -> Option<Literal> {
        if depth > MAX_DEPTH {
            return None;
        }
        self.rest = self.rest.trim_start();
        match self.rest.chars().next()? {
            '(' => self.many('(', ')', depth),
            '[' => self.many('[', ']', depth),
            '{' => {
                self.take('{');
                let mut all = Vec::new();
                while !self.take('}') {
                    let key = self.literal(depth + 1)?;
                    self.take(':').then_some(())?;
                    all.push((key, self.literal(depth + 1)?));
                    if !self.take(',') {
                        self.take('}').then_some(())?;
                        break;
                    }
                }
                Some(Literal::Map(all))
            }
            quote @ ('\'' | '"') => self.quoted(quote),
            sign if sign.is_ascii_digit() => {
                let end = self.rest.find(|sign: char| !sign.is_ascii_digit()).unwrap_or(self.rest.len());
                let (digits, rest) = self.rest.split_at_checked(end)?;
                // Python 2 wrote long numbers with a letter.
                self.rest = rest.strip_prefix('L').unwrap_or(rest);
                digits.parse().ok().map(Literal::Whole)
            }
            _ => {
                let words = [("True", Literal::Bool(true)), ("False", Literal::Bool(false)), ("None", Literal::None)];
                let (word, literal) = words.into_iter().find(|(word, _)| self.rest.starts_with(word))?;
                self.rest = self.rest.get(word.len()..)?;
                Some(literal)
            }
        }
    }

    fn many(&mut self, open: char, close: char, depth: usize) -> Option<Literal> {
        self.take(open);
        let mut all = Vec::new();
        while !self.take(close) {
            all.push(self.literal(depth + 1)?);
            if !self.take(',') {
                self.take(close).then_some(())?;
                break;
            }
        }
        Some(Literal::Many(all))
    }

    fn quoted(&mut self, quote: char) -> Option<Literal> {
        self.take(quote);
        let (mut text, mut escaped) = (String::new(), false);
        for (place, sign) in self.rest.char_indices() {
            match sign {
                _ if escaped => {
                    text.push(sign);
                    escaped = false;
                }
                '\\' => escaped = true,
                _ if sign == quote => {
                    self.rest = self.rest.get(place + sign.len_utf8()..)?;
                    return Some(Literal::Text(text));
                }
                _ => text.push(sign),
            }
        }
        None
    }
}
