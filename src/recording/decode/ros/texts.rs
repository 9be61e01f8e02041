//! Arrays of texts, such as the names of joints.

use super::super::DecodeError;
use super::super::plan::Field;
use super::super::row::{Names, Row};
use super::input::{Fault, Input};
use super::layout::Layout;
use super::program::{Count, Pick};
use crate::recording::limits::MAX_VECTOR_WIDTH;

/// Longest array of texts that is remembered, bytes.
const MAX_CACHED: usize = 1 << 16;

/// The texts of the message before. Joints have the same names in every message: equal bytes are not walked again.
#[derive(Debug, Clone, Default)]
pub(super) struct TextsCache {
    /// From the count, or the first length, to the end of the last text. Nothing is remembered if it is empty.
    bytes: Vec<u8>,
    is_big_endian: bool,
    /// What each pick took.
    names: Vec<Names>,
}

impl TextsCache {
    /// Takes the texts as before, if the same bytes come; else nothing is taken.
    pub(super) fn replay<const BIG: bool>(
        &self,
        input: &mut Input<'_, BIG>,
        picks: &[Pick],
        row: &mut Row,
    ) -> bool {
        if self.bytes.is_empty()
            || self.is_big_endian != BIG
            || !input.rest().starts_with(&self.bytes)
            || input.skip(self.bytes.len()).is_err()
        {
            return false;
        }
        for (pick, names) in picks.iter().zip(&self.names) {
            if let Field::Names(target) = pick.field {
                row.names(target).append(names);
            }
        }
        true
    }

    /// Takes the texts one by one and remembers them.
    pub(super) fn walk<const BIG: bool>(
        &mut self,
        input: &mut Input<'_, BIG>,
        layout: &Layout,
        count: Count,
        picks: &[Pick],
        row: &mut Row,
    ) -> Result<(), DecodeError> {
        self.bytes.clear();
        self.names.resize_with(picks.len(), Names::default);
        self.names.iter_mut().for_each(Names::clear);
        let start = input.at();
        let n = match count {
            Count::Fixed(n) => n,
            Count::Sequence => input.len().map_err(|fault| fault.error(layout))?,
        };
        let mask = layout.max_align.min(4) - 1;
        for index in 0..n {
            input.align(mask);
            let bytes = input
                .text(layout.is_terminated)
                .map_err(|fault: Fault| fault.error(layout))?;
            for (pick, names) in picks.iter().zip(&mut self.names) {
                if !pick.range.contains(&index) {
                    continue;
                }
                if names.len() >= MAX_VECTOR_WIDTH {
                    return Err(DecodeError::TooWide(row.label(pick.field)));
                }
                let text = utf8(bytes, layout)?;
                names.push(text);
                row.text(pick.field, text)?;
            }
        }
        if let Some(pick) = picks
            .iter()
            .find(|pick| pick.is_required && pick.range.start >= n)
        {
            return Err(DecodeError::Missing(row.label(pick.field)));
        }
        let taken = input.since(start);
        let are_names = picks
            .iter()
            .all(|pick| matches!(pick.field, Field::Names(_)));
        if are_names && taken.len() <= MAX_CACHED {
            self.bytes.extend_from_slice(taken);
            self.is_big_endian = BIG;
        }
        Ok(())
    }
}

/// The text of these bytes.
pub(super) fn utf8<'d>(bytes: &'d [u8], layout: &Layout) -> Result<&'d str, DecodeError> {
    std::str::from_utf8(bytes)
        .ok()
        .ok_or_else(|| layout.malformed("a text is not UTF-8"))
}
