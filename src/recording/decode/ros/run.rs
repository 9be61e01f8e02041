//! Takes the steps of a [`Program`] through one message.

use super::super::DecodeError;
use super::super::plan::Field;
use super::super::row::Row;
use super::input::{Fault, Input};
use super::layout::Layout;
use super::numbers;
use super::program::{Count, Op, Pick, Program, Segment};
use super::schema::Number;
use super::texts::{self, TextsCache};

/// Leaves in `row` what the program takes of `bytes`.
pub(super) fn run<const BIG: bool>(
    program: &mut Program,
    layout: &Layout,
    bytes: &[u8],
    row: &mut Row,
) -> Result<(), DecodeError> {
    for &target in &program.targets {
        // An array of structs may have no element: then the field is empty, not missing.
        row.values(target);
    }
    let mut run = Run::<BIG> {
        input: Input::new(bytes),
        layout,
        caches: &mut program.caches,
        row,
    };
    run.all(&program.ops)?;
    if run.input.left() > layout.max_left {
        return Err(layout.malformed("bytes are left behind its last field, its schema is another"));
    }
    Ok(())
}

struct Run<'a, 'd, const BIG: bool> {
    input: Input<'d, BIG>,
    layout: &'a Layout,
    caches: &'a mut [TextsCache],
    row: &'a mut Row,
}

impl<'d, const BIG: bool> Run<'_, 'd, BIG> {
    fn all(&mut self, ops: &[Op]) -> Result<(), DecodeError> {
        for op in ops {
            match op {
                Op::Align(mask) => self.input.align(*mask),
                Op::Skip(n) => self.sure(|input| input.skip(*n))?,
                Op::Numbers {
                    number,
                    count,
                    mask,
                    picks,
                } => self.numbers(*number, *count, *mask, picks)?,
                Op::SkipSequence { mask, size } => self.skip_sequence(*mask, *size)?,
                Op::Text(field) => self.text(*field)?,
                Op::Texts {
                    count,
                    picks,
                    cache,
                } => self.texts(*count, picks, *cache)?,
                Op::WideTexts(count) => self.wide_texts(*count)?,
                Op::Each {
                    count,
                    min_size,
                    segments,
                    others,
                } => self.each(*count, *min_size, segments, others)?,
                Op::Sized(ops) => self.sized(ops)?,
            }
        }
        Ok(())
    }

    #[inline]
    fn sure<T>(
        &mut self,
        take: impl FnOnce(&mut Input<'d, BIG>) -> Result<T, Fault>,
    ) -> Result<T, DecodeError> {
        take(&mut self.input).map_err(|fault| fault.error(self.layout))
    }

    fn count(&mut self, count: Count) -> Result<usize, DecodeError> {
        match count {
            Count::Fixed(n) => Ok(n),
            Count::Sequence => self.sure(Input::len),
        }
    }

    fn numbers(
        &mut self,
        number: Number,
        count: Count,
        mask: usize,
        picks: &[Pick],
    ) -> Result<(), DecodeError> {
        let n = self.count(count)?;
        if n > 0 {
            self.input.align(mask);
        }
        let size = number.size();
        let len = n.checked_mul(size);
        let Some(Ok(taken)) = len.map(|len| self.input.take(len)) else {
            return Err(Fault::Short.error(self.layout));
        };
        for pick in picks {
            let (start, end) = (pick.range.start.min(n), pick.range.end.min(n));
            // In range: `n` elements were taken, so the products are at most their length.
            let bytes = &taken[start * size..end.max(start) * size];
            numbers::take::<BIG>(number, bytes, pick.field, self.row)?;
            if pick.is_required && start == n {
                return Err(DecodeError::Missing(self.row.label(pick.field)));
            }
        }
        Ok(())
    }

    fn skip_sequence(&mut self, mask: usize, size: usize) -> Result<(), DecodeError> {
        let n = self.count(Count::Sequence)?;
        if n > 0 {
            self.input.align(mask);
        }
        self.sure(|input| input.skip(n.saturating_mul(size)))
    }

    fn text(&mut self, field: Option<Field>) -> Result<(), DecodeError> {
        let is_terminated = self.layout.is_terminated;
        let bytes = self
            .input
            .text(is_terminated)
            .map_err(|fault| fault.error(self.layout))?;
        match field {
            None => Ok(()),
            Some(field) => self.row.text(field, texts::utf8(bytes, self.layout)?),
        }
    }

    fn texts(&mut self, count: Count, picks: &[Pick], cache: usize) -> Result<(), DecodeError> {
        let cache = &mut self.caches[cache];
        if cache.replay(&mut self.input, picks, self.row) {
            return Ok(());
        }
        cache.walk(&mut self.input, self.layout, count, picks, self.row)
    }

    fn wide_texts(&mut self, count: Count) -> Result<(), DecodeError> {
        for _ in 0..self.count(count)? {
            self.input.align(self.layout.max_align.min(4) - 1);
            let layout = self.layout;
            self.sure(|input| input.wide_text(layout))?;
        }
        Ok(())
    }

    fn each(
        &mut self,
        count: Count,
        min_size: usize,
        segments: &[Segment],
        others: &[Op],
    ) -> Result<(), DecodeError> {
        let n = self.count(count)?;
        if n.checked_mul(min_size)
            .is_none_or(|len| len > self.input.left())
        {
            return Err(Fault::Short.error(self.layout));
        }
        let mut at = 0;
        for segment in segments {
            if let Some(field) = segment.required
                && segment.range.start >= n
            {
                return Err(DecodeError::Missing(self.row.label(field)));
            }
            let (start, end) = (segment.range.start.min(n), segment.range.end.min(n));
            for _ in at..start {
                self.all(others)?;
            }
            for _ in start..end {
                self.all(&segment.ops)?;
            }
            at = end.max(at);
        }
        for _ in at..n {
            self.all(others)?;
        }
        Ok(())
    }

    fn sized(&mut self, ops: &[Op]) -> Result<(), DecodeError> {
        let inner = self.sure(|input| {
            let n = input.len()?;
            input.split(n)
        })?;
        let outer = std::mem::replace(&mut self.input, inner);
        let result = self.all(ops);
        self.input = outer;
        result
    }
}
