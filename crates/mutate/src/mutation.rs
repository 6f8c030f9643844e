//! What can be done to a file: to its bytes, its numbers, its words, its lines.

use std::ops::Range;

use proptest::prelude::*;
use proptest::sample::{Index, select};

/// One change of a file. A place is a share of what there is of its kind.
#[derive(Clone, Debug)]
pub(crate) enum Mutation {
    /// One bit the other way.
    Flip(Index, u8),
    /// One byte, that formats have a meaning for, in place of another or before it.
    Byte(Index, u8, bool),
    /// A little-endian number over what is there: a length, a count, a bit pattern.
    Word(Index, u64, usize),
    /// Some bytes taken out.
    Cut(Index, usize),
    /// The end taken off.
    Truncate(Index),
    /// Some bytes of another file put in.
    Splice(Index, Index, Index, usize),
    /// Some bytes given again.
    Again(Index, usize),
    /// A number written in figures replaced.
    Number(Index, &'static str),
    /// A word replaced by another of the file.
    Name(Index, Index),
    /// A line repeated: a key or a row given twice, or very often.
    Repeat(Index, usize),
    /// A line taken out.
    Drop(Index),
    /// A line put before another.
    Move(Index, Index),
}

/// Bytes that formats have a meaning for.
const BYTES: [u8; 24] = *b"\0\n\r\t ,;:=.-+eE\"'[]{}#\\\xff\xef";

/// Numbers that no one means, or nearly so.
const NUMBERS: [&str; 28] = [
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e300",
    "-1e300",
    "1e-300",
    "1e999",
    "5e-324",
    "-0.0",
    "0",
    "-1",
    "1",
    "2",
    "1e5",
    "1000000",
    "4294967296",
    "9223372036854775807",
    "9223372036854775808",
    "18446744073709551615",
    "99999999999999999999999",
    "0.1e",
    "0x10",
    "1_000",
    "null",
    "\"\"",
    "true",
    "",
];

/// Numbers as bits: lengths and counts beyond what is there, infinities, NaN.
const WORDS: [u64; 12] = [
    0,
    1,
    0x7f,
    0xff,
    0xffff,
    0x7fff_ffff,
    0xffff_ffff,
    0x7fff_ffff_ffff_ffff,
    u64::MAX,
    0x7ff0_0000_0000_0000,
    0xfff8_0000_0000_0000,
    0x7fef_ffff_ffff_ffff,
];

/// Any change.
pub(crate) fn mutation() -> impl Strategy<Value = Mutation> {
    let place = any::<Index>;
    let length = || prop_oneof![4 => 1_usize..9, 2 => 1_usize..200, 1 => 1_usize..20_000];
    prop_oneof![
        2 => (place(), 0..8_u8).prop_map(|(at, bit)| Mutation::Flip(at, bit)),
        2 => (place(), select(&BYTES[..]), any::<bool>()).prop_map(|(at, b, new)| Mutation::Byte(at, b, new)),
        2 => (place(), select(&WORDS[..]), select(&[1_usize, 2, 4, 8][..]))
            .prop_map(|(at, word, width)| Mutation::Word(at, word, width)),
        2 => (place(), length()).prop_map(|(at, n)| Mutation::Cut(at, n)),
        1 => place().prop_map(Mutation::Truncate),
        2 => (place(), place(), place(), length()).prop_map(|(at, file, from, n)| Mutation::Splice(at, file, from, n)),
        1 => (place(), length()).prop_map(|(at, n)| Mutation::Again(at, n)),
        6 => (place(), select(&NUMBERS[..])).prop_map(|(at, number)| Mutation::Number(at, number)),
        3 => (place(), place()).prop_map(|(at, from)| Mutation::Name(at, from)),
        2 => (place(), prop_oneof![4 => 1..4_usize, 1 => 1..300_usize])
            .prop_map(|(at, times)| Mutation::Repeat(at, times)),
        2 => place().prop_map(Mutation::Drop),
        1 => (place(), place()).prop_map(|(from, to)| Mutation::Move(from, to)),
    ]
}

impl Mutation {
    pub(crate) fn apply(&self, bytes: &mut Vec<u8>, files: &[(String, Vec<u8>)]) {
        if bytes.is_empty() {
            return;
        }
        let size = bytes.len();
        let run = |at: &Index, n: usize, of: usize| {
            let from = at.index(of);
            from..(from + n).min(of)
        };
        match self {
            Self::Flip(at, bit) => bytes[at.index(size)] ^= 1 << bit,
            Self::Byte(at, byte, true) => bytes.insert(at.index(size), *byte),
            Self::Byte(at, byte, false) => bytes[at.index(size)] = *byte,
            Self::Word(at, word, width) => {
                let at = run(at, *width, size);
                let count = at.len();
                bytes[at].copy_from_slice(&word.to_le_bytes()[..count]);
            }
            Self::Cut(at, n) => drop(bytes.drain(run(at, *n, size))),
            Self::Truncate(at) => bytes.truncate(at.index(size)),
            Self::Splice(at, file, from, n) => {
                let (_, other) = &files[file.index(files.len())];
                if !other.is_empty() {
                    let at = at.index(size);
                    bytes.splice(at..at, other[run(from, *n, other.len())].iter().copied());
                }
            }
            Self::Again(at, n) => bytes.extend_from_within(run(at, *n, size)),
            Self::Number(at, number) => replace(bytes, &tokens(bytes, is_number), at, number.as_bytes()),
            Self::Name(at, from) => {
                let names = tokens(bytes, is_name);
                if !names.is_empty() {
                    let name = bytes[from.get(&names).clone()].to_vec();
                    replace(bytes, &names, at, &name);
                }
            }
            Self::Repeat(at, times) => {
                let line = at.get(&lines(bytes)).clone();
                let copies = bytes[line.clone()].repeat(*times);
                bytes.splice(line.end..line.end, copies);
            }
            Self::Drop(at) => drop(bytes.drain(at.get(&lines(bytes)).clone())),
            Self::Move(from, to) => {
                let line = from.get(&lines(bytes)).clone();
                let moved: Vec<u8> = bytes.drain(line).collect();
                let to = if bytes.is_empty() { 0 } else { to.get(&lines(bytes)).start };
                bytes.splice(to..to, moved);
            }
        }
    }
}

fn replace(bytes: &mut Vec<u8>, tokens: &[Range<usize>], at: &Index, by: &[u8]) {
    if !tokens.is_empty() {
        bytes.splice(at.get(tokens).clone(), by.iter().copied());
    }
}

const fn is_number(byte: u8) -> bool {
    byte.is_ascii_digit() || matches!(byte, b'.' | b'-' | b'+' | b'e')
}

const fn is_name(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

/// Runs of bytes of a kind that hold a figure, if it is numbers that are asked for, or a letter.
fn tokens(bytes: &[u8], kind: fn(u8) -> bool) -> Vec<Range<usize>> {
    let figures = kind(b'.');
    let mut found = Vec::new();
    let mut from = 0;
    while from < bytes.len() {
        let count = bytes[from..].iter().take_while(|byte| kind(**byte)).count();
        let token = &bytes[from..from + count];
        let begins =
            if figures { token.iter().any(u8::is_ascii_digit) } else { token.iter().any(u8::is_ascii_alphabetic) };
        if begins {
            found.push(from..from + count);
        }
        from += count.max(1);
    }
    found
}

/// Lines with their ends; at least one.
fn lines(bytes: &[u8]) -> Vec<Range<usize>> {
    let mut from = 0;
    let ends = bytes.split_inclusive(|byte| *byte == b'\n');
    ends.map(|line| {
        from += line.len();
        from - line.len()..from
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Corpus;

    #[test]
    fn tokens_are_whole_numbers_and_whole_words() {
        let text = b"reward = -2.5e-3, k_2 = 7";
        let found = |kind| -> Vec<&[u8]> { tokens(text, kind).into_iter().map(|at| &text[at]).collect() };
        assert_eq!(found(is_number), [&b"-2.5e-3"[..], b"2", b"7"]);
        assert_eq!(found(is_name), [&b"reward"[..], b"5e", b"k_2"]);
    }

    /// Most of what is made is nearly right: a file but for a stretch of it.
    #[test]
    fn mutants_keep_most_of_a_file() {
        let file: Vec<u8> = (0..200).flat_map(|i| format!("key_{i} = {i}\n").into_bytes()).collect();
        let corpus = Corpus::from([("file", file.clone())]);
        let near = |(_, mutant): &(String, Vec<u8>)| {
            let same = mutant.iter().zip(&file).take_while(|(a, b)| a == b).count();
            let end = mutant.iter().rev().zip(file.iter().rev()).take_while(|(a, b)| a == b).count();
            same + end > file.len() / 2
        };
        assert!(corpus.mutants(3).take(400).filter(near).count() > 200);
    }
}
