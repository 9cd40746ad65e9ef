//! OMG IDL 4.2, as far as ROS 2 writes it into logs: modules, structs, enums, typedefs, constants, annotations.

use std::collections::HashMap;

use super::{
    idl_tokens::{Token, TokenKind, tokens},
    link::{Definition, Kind, MAX_DEPTH, Member, link},
};
use crate::{Extensibility, Length, Scalar, Schema, Type};

/// Reads the definitions in `text` and joins those that `name` uses.
///
/// # Errors
/// A message that names the problem and its line.
pub(super) fn parse(name: &str, text: &str) -> Result<Schema, String> {
    let tokens = tokens(text)?;
    let mut parser = Parser { tokens: &tokens, place: 0, scope: Vec::new(), declarations: HashMap::new() };
    while parser.place < tokens.len() {
        parser.declaration()?;
    }
    Resolver { declarations: parser.declarations, list: Vec::new(), places: HashMap::new() }.schema(name)
}

/// Declaration of a name.
#[derive(Debug)]
enum Declared {
    Struct {
        base: Option<String>,
        members: Vec<(String, Spec, bool)>,
        extensibility: Option<Extensibility>,
    },
    Alias(Spec),
    Enum(Scalar),
    Number(u64),
    /// A kind of type that cannot be read.
    Refused(&'static str),
}

/// A type as it is written.
#[derive(Debug, Clone)]
enum Spec {
    Known(Type),
    Named(String),
    Sequence(Box<Spec>, Option<Size>),
    Array(Box<Spec>, Size),
}

/// A size or bound.
#[derive(Debug, Clone)]
enum Size {
    Number(u64),
    Named(String),
}

/// Annotations that apply to the next declaration.
#[derive(Debug, Default)]
struct Notes {
    optional: bool,
    extensibility: Option<Extensibility>,
    bits: Option<u64>,
}

struct Parser<'a> {
    tokens: &'a [Token<'a>],
    place: usize,
    /// The modules around.
    scope: Vec<&'a str>,
    /// By full name. A declaration remembers nothing of where it stands: names in it are looked up from its full name.
    declarations: HashMap<String, Declared>,
}

impl<'a> Parser<'a> {
    fn peek(&self) -> Option<TokenKind<'a>> {
        self.tokens.get(self.place).map(|token| token.kind)
    }

    fn next(&mut self) -> Option<TokenKind<'a>> {
        let kind = self.peek();
        self.place += 1;
        kind
    }

    fn error<T>(&self, problem: impl std::fmt::Display) -> Result<T, String> {
        // The word that did not fit has been passed.
        let line = self.tokens.get(self.place.saturating_sub(1)).or(self.tokens.last()).map_or(1, |token| token.line);
        Err(format!("line {line}: {problem}"))
    }

    fn take(&mut self, sign: char) -> bool {
        let is_next = self.peek() == Some(TokenKind::Sign(sign));
        self.place += usize::from(is_next);
        is_next
    }

    fn expect(&mut self, sign: char) -> Result<(), String> {
        match self.next() {
            Some(TokenKind::Sign(sign_there)) if sign_there == sign => Ok(()),
            _ => self.error(format_args!("`{sign}` is missing")),
        }
    }

    fn word(&mut self, word: &str) -> bool {
        let is_next = self.peek() == Some(TokenKind::Name(word));
        self.place += usize::from(is_next);
        is_next
    }

    fn name(&mut self) -> Result<&'a str, String> {
        match self.next() {
            Some(TokenKind::Name(name)) => Ok(name),
            _ => self.error("a name is missing"),
        }
    }

    fn declare(&mut self, name: &str, declared: Declared) {
        let full = self.scope.iter().copied().chain([name]).collect::<Vec<_>>().join("::");
        self.declarations.entry(full).or_insert(declared);
    }

    /// One declaration, or the end of a module.
    fn declaration(&mut self) -> Result<(), String> {
        let notes = self.notes()?;
        if self.take('}') {
            self.take(';');
            return if self.scope.pop().is_some() { Ok(()) } else { self.error("a module ends that has not begun") };
        }
        if self.take(';') {
            return Ok(());
        }
        match self.name()? {
            "module" => {
                let name = self.name()?;
                if self.scope.len() >= MAX_DEPTH {
                    return self.error(format_args!("modules lie more than {MAX_DEPTH} deep"));
                }
                self.scope.push(name);
                self.expect('{')
            }
            "struct" => self.structure(&notes),
            "typedef" => {
                let spec = self.spec(0)?;
                loop {
                    let (name, spec) = self.declarator(spec.clone())?;
                    self.declare(name, Declared::Alias(spec));
                    if !self.take(',') {
                        return self.expect(';');
                    }
                }
            }
            "enum" => self.enumeration(&notes),
            "const" => self.constant(),
            "union" => self.refused("a union, which cannot be read"),
            "bitmask" | "bitset" => self.refused("a set of bits, which cannot be read"),
            other => self.error(format_args!("`{other}` is not a declaration that can be read")),
        }
    }

    fn structure(&mut self, notes: &Notes) -> Result<(), String> {
        let name = self.name()?;
        // A forward declaration.
        if self.take(';') {
            return Ok(());
        }
        let base = if self.take(':') { Some(self.name()?.to_owned()) } else { None };
        self.expect('{')?;
        let mut members = Vec::new();
        while !self.take('}') {
            let notes = self.notes()?;
            let spec = self.spec(0)?;
            loop {
                let (name, spec) = self.declarator(spec.clone())?;
                members.push((name.to_owned(), spec, notes.optional));
                if !self.take(',') {
                    break;
                }
            }
            self.expect(';')?;
        }
        self.take(';');
        self.declare(name, Declared::Struct { base, members, extensibility: notes.extensibility });
        Ok(())
    }

    fn enumeration(&mut self, notes: &Notes) -> Result<(), String> {
        let name = self.name()?;
        self.skip_until('}')?;
        self.take(';');
        let scalar = match notes.bits {
            Some(1..=8) => Scalar::I8,
            Some(9..=16) => Scalar::I16,
            _ => Scalar::I32,
        };
        self.declare(name, Declared::Enum(scalar));
        Ok(())
    }

    /// A constant; those that are no whole number cannot be a size and are left out.
    fn constant(&mut self) -> Result<(), String> {
        self.spec(0)?;
        let name = self.name()?;
        self.expect('=')?;
        if let (Some(TokenKind::Number(value)), Some(token)) = (self.peek(), self.tokens.get(self.place + 1))
            && token.kind == TokenKind::Sign(';')
        {
            self.declare(name, Declared::Number(value));
        }
        self.skip_until(';')
    }

    /// A type that is only remembered so that its use can be refused.
    fn refused(&mut self, what: &'static str) -> Result<(), String> {
        let name = self.name()?;
        self.declare(name, Declared::Refused(what));
        let mut depth = 0_usize;
        loop {
            match self.next() {
                Some(TokenKind::Sign('{')) => depth += 1,
                Some(TokenKind::Sign('}')) => depth = depth.saturating_sub(1),
                Some(TokenKind::Sign(';')) if depth == 0 => return Ok(()),
                Some(_) => {}
                None => return self.error(format_args!("`{name}` does not end")),
            }
        }
    }

    fn skip_until(&mut self, sign: char) -> Result<(), String> {
        loop {
            match self.next() {
                Some(TokenKind::Sign(sign_there)) if sign_there == sign => return Ok(()),
                Some(_) => {}
                None => return self.error(format_args!("`{sign}` is missing")),
            }
        }
    }

    /// All annotations that come next.
    fn notes(&mut self) -> Result<Notes, String> {
        let mut notes = Notes::default();
        while self.take('@') {
            let name = self.name()?;
            let from = self.place;
            if self.take('(') {
                let mut depth = 1;
                while depth > 0 {
                    match self.next() {
                        Some(TokenKind::Sign('(')) => depth += 1,
                        Some(TokenKind::Sign(')')) => depth -= 1,
                        Some(_) => {}
                        None => return self.error(format_args!("the annotation @{name} does not end")),
                    }
                }
            }
            let arguments = self.tokens.get(from..self.place).unwrap_or_default();
            let has = |word: &str| arguments.iter().any(|token| token.kind == TokenKind::Name(word));
            match name {
                "optional" => notes.optional = !has("false") && !has("FALSE"),
                "final" => notes.extensibility = Some(Extensibility::Final),
                "appendable" => notes.extensibility = Some(Extensibility::Appendable),
                "mutable" => notes.extensibility = Some(Extensibility::Mutable),
                "extensibility" if has("FINAL") => notes.extensibility = Some(Extensibility::Final),
                "extensibility" if has("APPENDABLE") => notes.extensibility = Some(Extensibility::Appendable),
                "extensibility" if has("MUTABLE") => notes.extensibility = Some(Extensibility::Mutable),
                "bit_bound" => {
                    notes.bits = arguments.iter().find_map(|token| match token.kind {
                        TokenKind::Number(bits) => Some(bits),
                        _ => None,
                    });
                }
                _ => {}
            }
        }
        Ok(notes)
    }

    fn spec(&mut self, depth: usize) -> Result<Spec, String> {
        if depth >= MAX_DEPTH {
            return self.error(format_args!("types lie more than {MAX_DEPTH} deep"));
        }
        self.notes()?;
        let scalar = match self.name()? {
            "boolean" => Scalar::Bool,
            "octet" | "uint8" | "char" => Scalar::U8,
            "int8" => Scalar::I8,
            "short" | "int16" => Scalar::I16,
            "uint16" | "wchar" => Scalar::U16,
            "int32" => Scalar::I32,
            "uint32" => Scalar::U32,
            "int64" => Scalar::I64,
            "uint64" => Scalar::U64,
            "float" => Scalar::F32,
            "double" => Scalar::F64,
            "long" if self.word("double") => Scalar::LongDouble,
            "long" if self.word("long") => Scalar::I64,
            "long" => Scalar::I32,
            "unsigned" if self.word("short") => Scalar::U16,
            "unsigned" => match (self.word("long"), self.word("long")) {
                (true, true) => Scalar::U64,
                (true, false) => Scalar::U32,
                _ => return self.error("`unsigned` stands alone"),
            },
            name @ ("string" | "wstring") => {
                if self.take('<') {
                    self.size()?;
                    self.expect('>')?;
                }
                return Ok(Spec::Known(Type::Text { wide: name == "wstring" }));
            }
            "sequence" => {
                self.expect('<')?;
                let element = self.spec(depth + 1)?;
                let bound = if self.take(',') { Some(self.size()?) } else { None };
                self.expect('>')?;
                return Ok(Spec::Sequence(Box::new(element), bound));
            }
            name @ ("map" | "any" | "fixed" | "union" | "struct" | "enum") => {
                return self.error(format_args!("`{name}` cannot be read as the type of a field"));
            }
            name => return Ok(Spec::Named(self.scoped(name))),
        };
        Ok(Spec::Known(Type::Scalar(scalar)))
    }

    /// A name with the scope that it is looked up from.
    fn scoped(&self, name: &str) -> String {
        if name.starts_with("::") { name.to_owned() } else { format!("{}|{name}", self.scope.join("::")) }
    }

    fn size(&mut self) -> Result<Size, String> {
        match self.next() {
            Some(TokenKind::Number(value)) => Ok(Size::Number(value)),
            Some(TokenKind::Name(name)) => Ok(Size::Named(self.scoped(name))),
            _ => self.error("a size is missing"),
        }
    }

    /// A name, and the type that it has with the dimensions behind it.
    fn declarator(&mut self, spec: Spec) -> Result<(&'a str, Spec), String> {
        let name = self.name()?;
        let mut dimensions = Vec::new();
        while self.take('[') {
            if dimensions.len() >= MAX_DEPTH {
                return self.error("an array has too many dimensions");
            }
            dimensions.push(self.size()?);
            self.expect(']')?;
        }
        let spec = dimensions.into_iter().rev().fold(spec, |spec, size| Spec::Array(Box::new(spec), size));
        Ok((name, spec))
    }
}

/// Looks names up, and makes the list of definitions that the root uses.
struct Resolver {
    declarations: HashMap<String, Declared>,
    list: Vec<Definition>,
    /// Places in the list, by full names.
    places: HashMap<String, usize>,
}

impl Resolver {
    fn schema(mut self, name: &str) -> Result<Schema, String> {
        let full = name.replace('/', "::");
        let is_struct = |declared: Option<&Declared>| matches!(declared, Some(Declared::Struct { .. }));
        if !is_struct(self.declarations.get(&full)) {
            return Err(format!("the definition of `{name}` is missing: there is no struct {full}"));
        }
        let root = self.structure(&full)?;
        // Definitions are added while earlier ones are looked at.
        let mut next = 0;
        while next < self.list.len() {
            let full = self.list[next].name.replace('/', "::");
            self.list[next].fields = self.members(&full, 0)?;
            next += 1;
        }
        link(&self.list, root)
    }

    /// The place of a struct in the list.
    fn structure(&mut self, full: &str) -> Result<usize, String> {
        if let Some(&place) = self.places.get(full) {
            return Ok(place);
        }
        let extensibility = match self.declarations.get(full) {
            Some(Declared::Struct { extensibility, .. }) => *extensibility,
            _ => None,
        };
        if extensibility == Some(Extensibility::Mutable) {
            return Err(format!("`{full}` is @mutable: its members carry numbers (PL_CDR), which cannot be read"));
        }
        let place = self.list.len();
        self.list.push(Definition { name: full.replace("::", "/"), fields: Vec::new(), extensibility });
        self.places.insert(full.to_owned(), place);
        Ok(place)
    }

    fn members(&mut self, full: &str, depth: usize) -> Result<Vec<Member>, String> {
        let Some(Declared::Struct { base, members, .. }) = self.declarations.get(full) else {
            return Ok(time(full).into_iter().flatten().collect());
        };
        if depth >= MAX_DEPTH {
            return Err(format!("`{full}` inherits from itself or from too many"));
        }
        let (base, members) = (base.clone(), members.clone());
        let mut all = Vec::with_capacity(members.len());
        if let Some(base) = base {
            let scope = full.rsplit_once("::").map_or("", |(scope, _)| scope);
            let name = if base.starts_with("::") { base } else { format!("{scope}|{base}") };
            let base = self.look_up(&name).ok_or_else(|| format!("the definition of `{}` is missing", shown(&name)))?;
            all = self.members(&base, depth + 1)?;
        }
        for (name, spec, optional) in members {
            let kind = self.kind(&spec, 0).map_err(|problem| format!("the field `{name}` of `{full}`: {problem}"))?;
            all.push(Member { name, kind, optional });
        }
        Ok(all)
    }

    fn kind(&mut self, spec: &Spec, depth: usize) -> Result<Kind, String> {
        // Types inside types and names for names; so also typedefs that go round are found.
        if depth >= MAX_DEPTH / 2 {
            return Err(format!("its type lies more than {} typedefs and arrays deep", MAX_DEPTH / 2));
        }
        match spec {
            Spec::Known(kind) => Ok(Kind::Known(kind.clone())),
            Spec::Sequence(element, bound) => {
                let bound = bound.as_ref().map(|bound| self.size(bound)).transpose()?;
                Ok(Kind::Array(Box::new(self.kind(element, depth + 1)?), Length::Sequence(bound)))
            }
            Spec::Array(element, size) => {
                let size = self.size(size)?;
                Ok(Kind::Array(Box::new(self.kind(element, depth + 1)?), Length::Fixed(size)))
            }
            Spec::Named(name) => {
                let Some(full) = self.look_up(name) else { return Ok(Kind::Missing(shown(name))) };
                match self.declarations.get(&full) {
                    Some(Declared::Alias(spec)) => {
                        let spec = spec.clone();
                        self.kind(&spec, depth + 1)
                    }
                    Some(Declared::Enum(scalar)) => Ok(Kind::Known(Type::Scalar(*scalar))),
                    Some(Declared::Struct { .. }) | None => self.structure(&full).map(Kind::Struct),
                    Some(Declared::Refused(what)) => Err(format!("`{full}` is {what}")),
                    Some(Declared::Number(_)) => Err(format!("`{full}` is a constant, not a type")),
                }
            }
        }
    }

    fn size(&self, size: &Size) -> Result<usize, String> {
        let number = match size {
            Size::Number(number) => *number,
            Size::Named(name) => match self.look_up(name).and_then(|full| self.declarations.get(&full)) {
                Some(Declared::Number(number)) => *number,
                _ => return Err(format!("the size `{}` is not a constant of the text", shown(name))),
            },
        };
        usize::try_from(number).map_err(|_| format!("the size {number} is too large"))
    }

    /// The full name of what a name means: the innermost declaration counts.
    fn look_up(&self, name: &str) -> Option<String> {
        let exists = |full: &str| self.declarations.contains_key(full) || time(full).is_some();
        let Some((scope, name)) = name.split_once('|') else {
            let full = name.trim_start_matches("::");
            return exists(full).then(|| full.to_owned());
        };
        let mut scope = Some(scope).filter(|scope| !scope.is_empty());
        while let Some(around) = scope {
            let full = format!("{around}::{name}");
            if exists(&full) {
                return Some(full);
            }
            scope = around.rsplit_once("::").map(|(outer, _)| outer);
        }
        exists(name).then(|| name.to_owned())
    }
}

/// The well-known times, which texts may leave out.
fn time(full: &str) -> Option<[Member; 2]> {
    matches!(full, "builtin_interfaces::msg::Time" | "builtin_interfaces::msg::Duration").then(|| {
        [("sec", Scalar::I32), ("nanosec", Scalar::U32)].map(|(name, scalar)| Member {
            name: name.to_owned(),
            kind: Kind::Known(Type::Scalar(scalar)),
            optional: false,
        })
    })
}

/// A name as it stands in the text.
fn shown(name: &str) -> String {
    name.split_once('|').map_or(name, |(_, name)| name).to_owned()
}
