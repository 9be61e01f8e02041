//! What a plan is compiled to: a flat list of steps through the bytes of a message.

use std::ops::Range;

use super::super::plan::Field;
use super::schema::Number;
use super::texts::TextsCache;

/// Steps for one layout and one tree of wanted fields.
#[derive(Debug, Clone)]
pub(super) struct Program {
    pub(super) ops: Vec<Op>,
    /// Targets of which at least one field is in the schema, though arrays on its way may be empty.
    pub(super) targets: Vec<usize>,
    /// One for each [`Op::Texts`].
    pub(super) caches: Vec<TextsCache>,
}

/// A step. Arrays with a count of [`Count::Sequence`] start with it; the place is aligned for that.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Op {
    /// Pads to a power of two, given as it less one.
    Align(usize),
    Skip(usize),
    /// Numbers of one kind; without picks they are skipped.
    Numbers {
        number: Number,
        count: Count,
        /// Padding before the first of a sequence, as in [`Op::Align`].
        mask: usize,
        picks: Vec<Pick>,
    },
    /// A sequence of structs without padding between them, skipped.
    SkipSequence {
        mask: usize,
        size: usize,
    },
    Text(Option<Field>),
    Texts {
        count: Count,
        picks: Vec<Pick>,
        cache: usize,
    },
    WideTexts(Count),
    /// Structs.
    Each {
        count: Count,
        /// Fewest bytes of one, not zero.
        min_size: usize,
        segments: Vec<Segment>,
        /// For elements outside of all segments.
        others: Vec<Op>,
    },
    /// A size in bytes and what it is the size of. What is left of them behind the steps is skipped.
    Sized(Vec<Op>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Count {
    Fixed(usize),
    Sequence,
}

/// Elements of an array that a field takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Pick {
    pub(super) range: Range<usize>,
    pub(super) field: Field,
    /// A scalar that an array without these elements lacks.
    pub(super) is_required: bool,
}

/// Elements of an array of structs that the same is wanted of.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Segment {
    pub(super) range: Range<usize>,
    pub(super) ops: Vec<Op>,
    /// A scalar that is required below.
    pub(super) required: Option<Field>,
}

/// Steps as they are appended, with what is known of the place they lead to: it is a multiple of `modulus`, plus
/// `offset`. Padding that follows from it is no step of its own.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub(super) ops: Vec<Op>,
    modulus: usize,
    offset: usize,
    max_align: usize,
}

impl Block {
    /// Steps that start at a multiple of `modulus`.
    pub(super) fn new(max_align: usize, modulus: usize) -> Self {
        Self {
            ops: Vec::new(),
            modulus,
            offset: 0,
            max_align,
        }
    }

    /// The padding mask of values of this size.
    pub(super) fn mask(&self, size: usize) -> usize {
        size.min(self.max_align) - 1
    }

    /// Pads for a value of `size` bytes.
    pub(super) fn align(&mut self, size: usize) {
        let align = size.min(self.max_align);
        if self.modulus.is_multiple_of(align) {
            let over = self.offset % align;
            self.skip((align - over) % align);
        } else {
            self.ops.push(Op::Align(align - 1));
            self.modulus = align;
            self.offset = 0;
        }
    }

    pub(super) fn skip(&mut self, n: usize) {
        if n == 0 {
            return;
        }
        self.advance(n);
        match self.ops.last_mut() {
            Some(Op::Skip(before)) => *before = before.saturating_add(n),
            _ => self.ops.push(Op::Skip(n)),
        }
    }

    /// Takes `n` numbers that stand next.
    pub(super) fn numbers(&mut self, number: Number, n: usize, picks: Vec<Pick>) {
        self.align(number.size());
        self.advance(n.saturating_mul(number.size()));
        if let (
            Some(Op::Numbers {
                number: last,
                count: Count::Fixed(count),
                picks: before,
                ..
            }),
            [pick],
        ) = (self.ops.last_mut(), picks.as_slice())
            && let [taken] = before.as_mut_slice()
            && *last == number
            && matches!(pick.field, Field::Values(_))
            && taken.field == pick.field
            && taken.range == (0..*count)
            && pick.range == (0..n)
            && let Some(sum) = count.checked_add(n)
        {
            *count = sum;
            taken.range = 0..sum;
            return;
        }
        self.ops.push(Op::Numbers {
            number,
            count: Count::Fixed(n),
            mask: 0,
            picks,
        });
    }

    /// A step of unknown length that leads to a multiple of `modulus`.
    pub(super) fn push(&mut self, op: Op, modulus: usize) {
        self.ops.push(op);
        self.modulus = modulus.min(self.max_align);
        self.offset = 0;
    }

    fn advance(&mut self, n: usize) {
        self.offset = (self.offset + n % self.modulus) % self.modulus;
    }
}
