//! The grammar of JSON (RFC 8259) over a slice: tokens, strings, and values that nobody wants.

use super::error::Malformed;

/// Where a walk stands in a message.
#[derive(Debug)]
pub(super) struct Scanner<'a> {
    data: &'a [u8],
    at: usize,
}

impl<'a> Scanner<'a> {
    pub(super) fn new(data: &'a [u8]) -> Self {
        Self { data, at: 0 }
    }

    /// Offset of the byte that comes next, or that was refused.
    pub(super) fn offset(&self) -> usize {
        self.at
    }

    /// The byte that comes next. At the end it is NUL, which starts and ends nothing in JSON.
    #[inline]
    pub(super) fn peek(&self) -> u8 {
        self.data.get(self.at).copied().unwrap_or(0)
    }

    /// The byte that comes next behind white space.
    #[inline]
    pub(super) fn token(&mut self) -> u8 {
        loop {
            let byte = self.peek();
            if byte > b' ' || !matches!(byte, b' ' | b'\t' | b'\n' | b'\r') {
                return byte;
            }
            self.at += 1;
        }
    }

    /// Passes what was peeked.
    #[inline]
    pub(super) fn advance(&mut self, n_bytes: usize) {
        self.at += n_bytes;
    }

    /// The bytes from `start` to where the walk stands.
    pub(super) fn since(&self, start: usize) -> &'a [u8] {
        self.data.get(start..self.at).unwrap_or_default()
    }

    /// What is left of the message.
    #[inline]
    pub(super) fn rest(&self) -> &'a [u8] {
        self.data.get(self.at..).unwrap_or_default()
    }

    /// The eight bytes from `n_ahead` on, the first one lowest, NUL behind the end.
    #[inline]
    pub(super) fn word(&self, n_ahead: usize) -> u64 {
        if let Some(rest) = self.data.get(self.at + n_ahead..) {
            if let Some(bytes) = rest.first_chunk() {
                return u64::from_le_bytes(*bytes);
            }
            return last_word(rest);
        }
        0
    }

    /// What is wrong with the byte that comes next, or with the end.
    #[cold]
    pub(super) fn unexpected(&self, at_end: Malformed, other: Malformed) -> Malformed {
        if self.at < self.data.len() {
            other
        } else {
            at_end
        }
    }

    /// Only white space may follow.
    pub(super) fn end(&mut self) -> Result<(), Malformed> {
        self.token();
        if self.at < self.data.len() {
            return Err(Malformed::TrailingCharacters);
        }
        Ok(())
    }

    /// Passes `true`, `false` or `null`, whose first byte was seen.
    pub(super) fn literal(&mut self, literal: &[u8]) -> Result<(), Malformed> {
        for &byte in literal {
            if self.peek() != byte {
                return Err(self.unexpected(Malformed::EndInValue, Malformed::ExpectedIdent));
            }
            self.at += 1;
        }
        Ok(())
    }

    /// Comes to the key of a member, if there is one. `is_first`: behind the brace.
    #[inline]
    pub(super) fn next_member(&mut self, is_first: bool) -> Result<bool, Malformed> {
        match self.token() {
            b'}' => {
                self.at += 1;
                return Ok(false);
            }
            b',' if !is_first => {
                self.at += 1;
                if self.token() == b'}' {
                    return Err(Malformed::TrailingComma);
                }
            }
            _ if is_first => {}
            _ => return Err(self.unexpected(Malformed::EndInObject, Malformed::ObjectCommaOrEnd)),
        }
        if self.token() != b'"' {
            return Err(self.unexpected(Malformed::EndInObject, Malformed::KeyMustBeAString));
        }
        Ok(true)
    }

    /// Comes to an element of an array, if there is one. `is_first`: behind the bracket.
    #[inline]
    pub(super) fn next_element(&mut self, is_first: bool) -> Result<bool, Malformed> {
        match self.token() {
            b']' => {
                self.at += 1;
                Ok(false)
            }
            0 if self.at >= self.data.len() => Err(Malformed::EndInList),
            _ if is_first => Ok(true),
            b',' => {
                self.at += 1;
                match self.token() {
                    b']' => Err(Malformed::TrailingComma),
                    0 if self.at >= self.data.len() => Err(Malformed::EndInValue),
                    _ => Ok(true),
                }
            }
            _ => Err(self.unexpected(Malformed::EndInList, Malformed::ListCommaOrEnd)),
        }
    }

    /// Passes the colon behind a key.
    #[inline]
    pub(super) fn colon(&mut self) -> Result<(), Malformed> {
        if self.token() != b':' {
            return Err(self.unexpected(Malformed::EndInObject, Malformed::ExpectedColon));
        }
        self.at += 1;
        Ok(())
    }

    /// The string that starts at the quote that was seen. `scratch` holds it where it has escapes.
    #[inline]
    pub(super) fn text<'s>(&mut self, scratch: &'s mut Vec<u8>) -> Result<&'s str, Malformed>
    where
        'a: 's,
    {
        self.at += 1;
        let start = self.at;
        let bytes = if self.plain_run()? == b'"' {
            let bytes = self.since(start);
            self.at += 1;
            bytes
        } else {
            self.escaped_text(start, scratch)?;
            scratch.as_slice()
        };
        std::str::from_utf8(bytes).map_err(|_invalid| Malformed::InvalidUnicode)
    }

    /// The rest of a string whose first escape comes next.
    fn escaped_text(&mut self, start: usize, scratch: &mut Vec<u8>) -> Result<(), Malformed> {
        scratch.clear();
        let mut run_start = start;
        loop {
            let stop = self.plain_run()?;
            scratch.extend_from_slice(self.since(run_start));
            self.at += 1;
            if stop == b'"' {
                return Ok(());
            }
            self.escape(scratch)?;
            run_start = self.at;
        }
    }

    /// Comes to the quote or backslash that ends a run of plain bytes.
    #[inline]
    fn plain_run(&mut self) -> Result<u8, Malformed> {
        self.at += plain_len(self.data.get(self.at..).unwrap_or_default());
        match self.peek() {
            stop @ (b'"' | b'\\') => Ok(stop),
            _ => Err(self.unexpected(Malformed::EndInString, Malformed::ControlCharacter)),
        }
    }

    /// What an escape stands for; its backslash is passed.
    fn escape(&mut self, out: &mut Vec<u8>) -> Result<(), Malformed> {
        let byte = match self.peek() {
            byte @ (b'"' | b'\\' | b'/') => byte,
            b'b' => 0x08,
            b'f' => 0x0c,
            b'n' => b'\n',
            b'r' => b'\r',
            b't' => b'\t',
            b'u' => {
                self.at += 1;
                let mut utf8 = [0; 4];
                let character = self.unicode_escape()?.encode_utf8(&mut utf8);
                out.extend_from_slice(character.as_bytes());
                return Ok(());
            }
            _ => return Err(self.unexpected(Malformed::EndInString, Malformed::InvalidEscape)),
        };
        self.at += 1;
        out.push(byte);
        Ok(())
    }

    /// The character behind `\u`, which may take a second escape.
    fn unicode_escape(&mut self) -> Result<char, Malformed> {
        let first = self.hex()?;
        if let Some(character) = char::from_u32(first) {
            return Ok(character);
        }
        let is_leading = (0xd800..0xdc00).contains(&first);
        if !is_leading {
            return Err(Malformed::LoneSurrogate);
        }
        for expected in *b"\\u" {
            if self.peek() != expected {
                return Err(self.unexpected(Malformed::EndInString, Malformed::EndOfHexEscape));
            }
            self.at += 1;
        }
        let second = self.hex()?;
        if !(0xdc00..0xe000).contains(&second) {
            return Err(Malformed::LoneSurrogate);
        }
        let code = 0x1_0000 + ((first - 0xd800) << 10) + (second - 0xdc00);
        char::from_u32(code).ok_or(Malformed::LoneSurrogate)
    }

    /// Four hexadecimal digits.
    fn hex(&mut self) -> Result<u32, Malformed> {
        let rest = self.data.get(self.at..).unwrap_or_default();
        let Some(digits) = rest.first_chunk::<4>() else {
            self.at = self.data.len();
            return Err(Malformed::EndInString);
        };
        self.at += 4;
        digits
            .iter()
            .try_fold(0, |code, &digit| {
                Some(code << 4 | char::from(digit).to_digit(16)?)
            })
            .ok_or(Malformed::InvalidEscape)
    }

    /// Passes a value that nobody wants. As in `serde_json` it may be nested to any depth, it need not be UTF-8, and
    /// its numbers may be beyond f64.
    pub(super) fn skip(&mut self) -> Result<(), Malformed> {
        let mut open = Open::default();
        loop {
            match self.token() {
                b'"' => self.skip_text()?,
                b'-' | b'0'..=b'9' => self.skip_number()?,
                b'n' => self.literal(b"null")?,
                b't' => self.literal(b"true")?,
                b'f' => self.literal(b"false")?,
                b'[' => {
                    self.at += 1;
                    if self.token() != b']' {
                        open.push(Container::Array);
                        continue;
                    }
                    self.at += 1;
                }
                b'{' => {
                    self.at += 1;
                    if self.token() != b'}' {
                        open.push(Container::Object);
                        self.skip_key()?;
                        continue;
                    }
                    self.at += 1;
                }
                _ => return Err(self.unexpected(Malformed::EndInValue, Malformed::ExpectedValue)),
            }
            if !self.skip_behind_value(&mut open)? {
                return Ok(());
            }
        }
    }

    /// Comes to the next value inside of what is open; false if the outermost is closed.
    #[inline]
    fn skip_behind_value(&mut self, open: &mut Open) -> Result<bool, Malformed> {
        while let Some(container) = open.last() {
            match (self.token(), container) {
                (b',', Container::Array) => {
                    self.at += 1;
                    return Ok(true);
                }
                (b',', Container::Object) => {
                    self.at += 1;
                    self.skip_key()?;
                    return Ok(true);
                }
                (b']', Container::Array) | (b'}', Container::Object) => {
                    self.at += 1;
                    open.pop();
                }
                (_, Container::Array) => {
                    return Err(self.unexpected(Malformed::EndInList, Malformed::ListCommaOrEnd));
                }
                (_, Container::Object) => {
                    return Err(
                        self.unexpected(Malformed::EndInObject, Malformed::ObjectCommaOrEnd)
                    );
                }
            }
        }
        Ok(false)
    }

    fn skip_key(&mut self) -> Result<(), Malformed> {
        if self.token() != b'"' {
            return Err(self.unexpected(Malformed::EndInObject, Malformed::KeyMustBeAString));
        }
        self.skip_text()?;
        self.colon()
    }

    /// Passes a string whose quote was seen.
    fn skip_text(&mut self) -> Result<(), Malformed> {
        self.at += 1;
        loop {
            let stop = self.plain_run()?;
            self.at += 1;
            if stop == b'"' {
                return Ok(());
            }
            match self.peek() {
                b'"' | b'\\' | b'/' | b'b' | b'f' | b'n' | b'r' | b't' => self.at += 1,
                b'u' => {
                    self.at += 1;
                    self.hex()?;
                }
                _ => return Err(self.unexpected(Malformed::EndInString, Malformed::InvalidEscape)),
            }
        }
    }
}

/// What is left where it is shorter than a word.
#[cold]
fn last_word(rest: &[u8]) -> u64 {
    let mut bytes = [0; 8];
    for (to, from) in bytes.iter_mut().zip(rest) {
        *to = *from;
    }
    u64::from_le_bytes(bytes)
}

/// Length of the run that has no quote, no backslash and no control character.
#[inline]
fn plain_len(bytes: &[u8]) -> usize {
    let (words, tail) = bytes.as_chunks::<8>();
    let mut len = 0;
    // Keys and names end in the first words; only what is longer is worth a wide block.
    for word in words.iter().take(WORDS_BEFORE_BLOCKS) {
        let special = special_bytes(u64::from_le_bytes(*word));
        if special != 0 {
            return len + (special.trailing_zeros() / 8) as usize;
        }
        len += 8;
    }
    if words.len() > WORDS_BEFORE_BLOCKS {
        return len + long_plain_len(&bytes[len..]);
    }
    len + plain_len_by_byte(tail)
}

/// Words that are looked at one by one.
const WORDS_BEFORE_BLOCKS: usize = 8;

/// [`plain_len`] for long strings: blocks that the compiler makes vector instructions of.
#[inline(never)]
fn long_plain_len(bytes: &[u8]) -> usize {
    let (blocks, _) = bytes.as_chunks::<64>();
    let n_plain = blocks
        .iter()
        .take_while(|block| {
            block
                .iter()
                .fold(0, |any, &b| any | u8::from(is_special(b)))
                == 0
        })
        .count();
    let len = 64 * n_plain;
    len + plain_len_by_byte(&bytes[len..])
}

fn plain_len_by_byte(bytes: &[u8]) -> usize {
    bytes
        .iter()
        .position(|&b| is_special(b))
        .unwrap_or(bytes.len())
}

#[inline]
fn is_special(byte: u8) -> bool {
    matches!(byte, 0..0x20 | b'"' | b'\\')
}

/// The high bit of each byte that is a quote, a backslash or a control character, right up to the first such byte.
#[inline]
fn special_bytes(word: u64) -> u64 {
    const ONES: u64 = u64::MAX / 255;
    let quote = word ^ (ONES * u64::from(b'"'));
    let backslash = word ^ (ONES * u64::from(b'\\'));
    // A byte below the subtrahend borrows from the next one: only the lowest bit that is set is sure to be right.
    let below = |bytes: u64, limit: u64| bytes.wrapping_sub(ONES * limit) & !bytes;
    (below(word, 0x20) | below(quote, 1) | below(backslash, 1)) & (ONES << 7)
}

/// An array or an object that is not closed yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Container {
    Array,
    Object,
}

/// What is open around a value, a bit for each. The first 64 levels need no memory.
#[derive(Default)]
struct Open {
    depth: usize,
    /// The innermost levels, the last one lowest.
    bits: u64,
    outer: Vec<u64>,
}

impl Open {
    #[inline]
    fn push(&mut self, container: Container) {
        if self.depth > 0 && self.depth.is_multiple_of(64) {
            self.outer.push(self.bits);
        }
        self.bits = self.bits << 1 | u64::from(container == Container::Object);
        self.depth += 1;
    }

    #[inline]
    fn pop(&mut self) {
        self.bits >>= 1;
        self.depth = self.depth.saturating_sub(1);
        if self.depth > 0 && self.depth.is_multiple_of(64) {
            self.bits = self.outer.pop().unwrap_or(0);
        }
    }

    #[inline]
    fn last(&self) -> Option<Container> {
        (self.depth > 0).then_some(if self.bits & 1 == 1 {
            Container::Object
        } else {
            Container::Array
        })
    }
}
