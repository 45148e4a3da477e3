//! One mistake in a valid file, for tests of parsers in all crates.

use core::ops::Range;
use proptest::prelude::*;
use proptest::sample::{Index, select};

/// Words that may stand where a number stood.
const NO_NUMBERS: [&str; 14] = [
    "NaN",
    "-nan",
    "inf",
    "1e308",
    "-1e308",
    "1e400",
    "1e-320",
    "-1",
    "0",
    "",
    " ",
    "x",
    "1,5",
    "99999999999999999999",
];

/// One mistake.
#[derive(Debug, Clone)]
pub enum Mistake {
    /// The file ends too early.
    Cut(Index),
    /// A byte is another.
    Byte(Index, u8),
    /// Something else stands where a number stood.
    Number(Index, &'static str),
    /// A line is missing.
    LineLost(Index),
    /// A line is there twice.
    LineTwice(Index),
}

/// Any mistake.
pub fn mistake() -> impl Strategy<Value = Mistake> {
    let anywhere = any::<Index>;
    prop_oneof![
        anywhere().prop_map(Mistake::Cut),
        (anywhere(), any::<u8>()).prop_map(|(at, byte)| Mistake::Byte(at, byte)),
        (anywhere(), select(NO_NUMBERS.to_vec())).prop_map(|(at, word)| Mistake::Number(at, word)),
        anywhere().prop_map(Mistake::LineLost),
        anywhere().prop_map(Mistake::LineTwice),
    ]
}

impl Mistake {
    /// The file with the mistake; a number that it does not have would have stood at its beginning.
    ///
    /// # Panics
    ///
    /// When the file is empty.
    #[must_use]
    pub fn made_in(&self, file: &[u8]) -> Vec<u8> {
        let replaced =
            |part: Range<usize>, by: &[u8]| [&file[..part.start], by, &file[part.end..]].concat();
        match self {
            Self::Cut(at) => file[..at.index(file.len())].to_vec(),
            Self::Byte(at, byte) => {
                let at = at.index(file.len());
                replaced(at..at + 1, &[*byte])
            }
            Self::Number(at, word) => replaced(at.get(&numbers(file)).clone(), word.as_bytes()),
            Self::LineLost(at) => replaced(at.get(&lines(file)).clone(), &[]),
            Self::LineTwice(at) => {
                let line = at.get(&lines(file)).clone();
                replaced(line.end..line.end, &file[line])
            }
        }
    }
}

/// The parts of a file of which `is_end` says where each ends, counted in bytes.
fn parts(file: &[u8], is_end: impl Fn(u8, u8) -> bool) -> Vec<Range<usize>> {
    let ends =
        (1..=file.len()).filter(|&end| end == file.len() || is_end(file[end - 1], file[end]));
    let mut start = 0;
    ends.map(|end| core::mem::replace(&mut start, end)..end).collect()
}

fn lines(file: &[u8]) -> Vec<Range<usize>> {
    parts(file, |last, _| last == b'\n')
}

fn numbers(file: &[u8]) -> Vec<Range<usize>> {
    let is_in_number = |byte: u8| byte.is_ascii_digit() || b"+-.".contains(&byte);
    let mut numbers = parts(file, |last, next| is_in_number(last) != is_in_number(next));
    numbers.retain(|part| file[part.clone()].iter().any(u8::is_ascii_digit));
    if numbers.is_empty() {
        numbers.push(0..0);
    }
    numbers
}

#[test]
fn a_mistake_is_where_it_was_asked_for() {
    let file = b"v -1.5 2\nf 30\n";
    assert_eq!(
        numbers(file).iter().map(|part| &file[part.clone()]).collect::<Vec<_>>(),
        [&b"-1.5"[..], b"2", b"30"]
    );
    assert_eq!(lines(file), [0..9, 9..14]);
}
