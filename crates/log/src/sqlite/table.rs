//! Tables: their columns, and the leaves of their trees.

use super::{
    database::{Database, FILE_HEADER},
    row::{Row, Value},
};

/// Depth beyond which no tree goes: a page has at least four children.
const MAX_DEPTH: usize = 24;

/// Leaves after which the memory of those before is given back: the system maps sixteen pages for each that is read.
const RELEASED: usize = 1024;

/// Kinds of pages.
const LEAF: u8 = 0x0d;
const INTERIOR: u8 = 0x05;

/// A table of a database.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Table {
    root: u32,
    /// Names of the columns in the order of records.
    columns: Vec<String>,
    /// The column that the row id stands for.
    id: Option<usize>,
}

/// Leaves of a table.
#[derive(Debug, Default)]
pub(crate) struct Leaves {
    /// Page numbers in the order of the rows.
    pub(crate) pages: Vec<u32>,
    /// Page numbers at which the tree is damaged.
    pub(crate) damaged: Vec<u32>,
}

impl Table {
    /// The table of a name; `None` where the database has none that can be read.
    pub(crate) fn of(database: &Database, name: &str) -> Option<Self> {
        // type, name, tbl_name, rootpage, sql
        let schema = Self { root: 1, columns: Vec::new(), id: None };
        let text = |row: &Row<'_>, column| match row.value(column) {
            Some(Value::Text(text)) => Some(text),
            _ => None,
        };
        schema.leaves(database).pages.iter().flat_map(|&page| schema.rows(database, page)).flatten().find_map(|row| {
            let is_wanted = text(&row, 0)? == "table" && text(&row, 1)?.eq_ignore_ascii_case(name);
            let root = is_wanted.then(|| row.integers([3]))??[0];
            let (columns, id) = columns(&text(&row, 4)?)?;
            Some(Self { root: u32::try_from(root).ok()?, columns, id })
        })
    }

    /// The place of a column in records.
    pub(crate) fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column_name| column_name.eq_ignore_ascii_case(name))
    }

    /// An integer of a row, which may be its id.
    pub(crate) fn integer(&self, row: &Row<'_>, column: usize) -> Option<i64> {
        if self.id == Some(column) { Some(row.id) } else { row.integers([column]).map(|[value]| value) }
    }

    /// The leaves, from the first row to the last.
    pub(crate) fn leaves(&self, database: &Database) -> Leaves {
        let mut leaves = Leaves::default();
        let mut seen = vec![false; database.pages() + 1];
        // Children are put on the stack from the last to the first.
        let mut stack = vec![(self.root, 0)];
        while let Some((number, depth)) = stack.pop() {
            let fresh = seen.get_mut(number as usize).is_some_and(|seen| !std::mem::replace(seen, true));
            match database
                .page(number)
                .filter(|_| fresh && depth < MAX_DEPTH)
                .and_then(|page| Page::parse(number, page))
            {
                Some(Page { kind: LEAF, .. }) => {
                    leaves.pages.push(number);
                    if leaves.pages.len().is_multiple_of(RELEASED) {
                        database.release();
                    }
                }
                Some(page) => {
                    stack.extend(page.last_child.map(|child| (child, depth + 1)));
                    let children: Vec<u32> = page.cells().filter_map(|place| page.word(place)).collect();
                    stack.extend(children.into_iter().rev().map(|child| (child, depth + 1)));
                }
                None => leaves.damaged.push(number),
            }
        }
        leaves
    }

    /// The rows of a leaf; `None` for one that is damaged.
    pub(crate) fn rows<'a>(
        &self,
        database: &'a Database,
        leaf: u32,
    ) -> impl Iterator<Item = Option<Row<'a>>> + use<'a> {
        let page = database.page(leaf).and_then(|page| Page::parse(leaf, page)).filter(|page| page.kind == LEAF);
        let places: Vec<usize> = page.as_ref().map_or_else(Vec::new, |page| page.cells().collect());
        places.into_iter().map(move |place| Row::at(database, page.as_ref()?.bytes, place))
    }
}

/// A page of a tree.
struct Page<'a> {
    kind: u8,
    bytes: &'a [u8],
    /// Places of cells, two bytes each.
    pointers: &'a [u8],
    /// The child behind all cells of an interior page.
    last_child: Option<u32>,
}

impl<'a> Page<'a> {
    fn parse(number: u32, bytes: &'a [u8]) -> Option<Self> {
        let start = if number == 1 { FILE_HEADER } else { 0 };
        let kind = *bytes.get(start)?;
        let head = match kind {
            LEAF => 8,
            INTERIOR => 12,
            _ => return None,
        };
        let count = usize::from(u16::from_be_bytes(*bytes.get(start + 3..)?.first_chunk::<2>()?));
        let pointers = bytes.get(start + head..)?.get(..2 * count)?;
        let page = Self { kind, bytes, pointers, last_child: None };
        let last_child = if kind == INTERIOR { Some(page.word(start + 8)?) } else { None };
        Some(Self { last_child, ..page })
    }

    fn cells(&self) -> impl Iterator<Item = usize> + use<'a> {
        self.pointers.as_chunks::<2>().0.iter().map(|pair| usize::from(u16::from_be_bytes(*pair)))
    }

    fn word(&self, place: usize) -> Option<u32> {
        Some(u32::from_be_bytes(*self.bytes.get(place..)?.first_chunk::<4>()?))
    }
}

/// Names of the columns that a `CREATE TABLE` declares, and the one that the row id stands for.
fn columns(sql: &str) -> Option<(Vec<String>, Option<usize>)> {
    let body = sql.get(sql.find('(')? + 1..sql.rfind(')')?)?;
    let (mut depth, mut start, mut parts) = (0_usize, 0, Vec::new());
    for (at, character) in body.char_indices() {
        match character {
            '(' => depth += 1,
            ')' => depth = depth.saturating_sub(1),
            ',' if depth == 0 => {
                parts.push(body.get(start..at)?);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(body.get(start..)?);
    let (mut names, mut id) = (Vec::new(), None);
    for part in parts {
        let mut words = part.split_ascii_whitespace();
        let Some(name) = words.next() else { continue };
        let bare = name.split('(').next().unwrap_or(name).to_ascii_uppercase();
        if matches!(bare.as_str(), "PRIMARY" | "UNIQUE" | "CHECK" | "FOREIGN" | "CONSTRAINT") {
            continue;
        }
        let rest: Vec<String> = words.map(str::to_ascii_uppercase).collect();
        if rest.first().is_some_and(|kind| kind == "INTEGER") && rest.windows(2).any(|pair| pair == ["PRIMARY", "KEY"])
        {
            id = Some(names.len());
        }
        names.push(name.trim_matches(['"', '`', '[', ']', '\'']).to_owned());
    }
    Some((names, id))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_match_the_declaration() {
        let (names, id) = columns(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,\"timestamp\" INTEGER NOT NULL, data BLOB NOT NULL, \
             FOREIGN KEY(topic_id) REFERENCES topics(id))",
        )
        .unwrap();
        assert_eq!(names, ["id", "topic_id", "timestamp", "data"]);
        assert_eq!(id, Some(0));
        let (names, id) = columns("CREATE TABLE t(a DECIMAL(10,2), b INT PRIMARY KEY)").unwrap();
        assert_eq!((names, id), (vec!["a".to_owned(), "b".to_owned()], None));
        assert_eq!(columns("CREATE TABLE t"), None);
    }
}
