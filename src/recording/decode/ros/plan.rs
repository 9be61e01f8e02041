//! Compiles a tree of wanted fields and the types of a message to a [`Program`].

use super::super::PlanError;
use super::super::plan::{Field, Leaf, Node};
use super::fit::{Place, Want};
use super::layout::Layout;
use super::program::{Block, Count, Op, Pick, Program, Segment};
use super::schema::{Member, Shape, Struct, Type, Types};
use super::texts::TextsCache;

/// Most members that are visited: types that hold each other several times grow with a power of their depth.
const MAX_VISITS: usize = 1 << 17;

/// Compiles one tree for one layout.
pub(super) fn compile(
    types: &Types,
    layout: &Layout,
    tree: &Node,
) -> Result<Program, CompileError> {
    let mut compiler = Compiler {
        types,
        layout,
        visits_left: MAX_VISITS,
        targets: Vec::new(),
        n_caches: 0,
    };
    let root = Type::Struct(types.root);
    let place = Place::root(types);
    let mut block = Block::new(layout.max_align, layout.max_align);
    let want = compiler.settle(root, Want::Node(tree), place)?;
    compiler.one(&mut block, root, want, place)?;
    let mut caches = Vec::new();
    caches.resize_with(compiler.n_caches, TextsCache::default);
    Ok(Program {
        ops: block.ops,
        targets: compiler.targets,
        caches,
    })
}

/// Why there is no program.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum CompileError {
    /// A required path does not fit the types.
    Path(String),
    TooLarge,
}

impl CompileError {
    pub(super) fn plan_error(self, name: &str, encoding: &str) -> PlanError {
        match self {
            Self::Path(text) => PlanError::Path(text),
            Self::TooLarge => PlanError::Schema {
                name: name.to_owned(),
                encoding: encoding.to_owned(),
                what: "it has too many fields".to_owned(),
            },
        }
    }
}

pub(super) struct Compiler<'t> {
    pub(super) types: &'t Types,
    layout: &'t Layout,
    visits_left: usize,
    targets: Vec<usize>,
    n_caches: usize,
}

impl<'t> Compiler<'t> {
    /// One value.
    fn one(
        &mut self,
        block: &mut Block,
        ty: Type,
        want: Want<'_>,
        place: Place<'t>,
    ) -> Result<(), CompileError> {
        self.visits_left = self
            .visits_left
            .checked_sub(1)
            .ok_or(CompileError::TooLarge)?;
        match ty {
            Type::Number(number) => {
                if let Some(leaf) = self.scalar(ty, want, place)? {
                    block.numbers(number, 1, vec![self.pick(0..1, &leaf)]);
                } else {
                    block.align(number.size());
                    block.skip(number.size());
                }
            }
            Type::Text => {
                let leaf = self.scalar(ty, want, place)?;
                block.align(4);
                block.push(Op::Text(leaf.map(|l| self.pick(0..1, &l).field)), 1);
            }
            Type::WideText => {
                self.scalar(ty, want, place)?;
                block.align(4);
                block.push(Op::WideTexts(Count::Fixed(1)), 1);
            }
            Type::Struct(index) => {
                let is_sized = self.layout.has_struct_sizes;
                self.sized(block, is_sized, |this, block| {
                    this.members(block, index, want, place)
                })?;
            }
        }
        Ok(())
    }

    fn members(
        &mut self,
        block: &mut Block,
        index: usize,
        want: Want<'_>,
        place: Place<'t>,
    ) -> Result<(), CompileError> {
        let types = self.types;
        let of = &types.structs[index];
        let wanted = self.wanted_members(index, want, place)?;
        for (i, member) in of.members.iter().enumerate() {
            let want = match want {
                Want::Node(_) => wanted[i],
                other => other,
            };
            self.member(block, of, member, want)?;
        }
        block.skip(of.padding);
        Ok(())
    }

    fn member(
        &mut self,
        block: &mut Block,
        owner: &'t Struct,
        member: &'t Member,
        want: Want<'_>,
    ) -> Result<(), CompileError> {
        let place = Place::of(owner, member);
        let want = self.settle(member.ty, want, place)?;
        match member.shape {
            Shape::One => self.one(block, member.ty, want, place),
            Shape::Array(n) => self.collection(block, member.ty, Count::Fixed(n), want, place),
            Shape::Sequence => self.collection(block, member.ty, Count::Sequence, want, place),
        }
    }

    /// An array or a sequence.
    fn collection(
        &mut self,
        block: &mut Block,
        ty: Type,
        count: Count,
        want: Want<'_>,
        place: Place<'t>,
    ) -> Result<(), CompileError> {
        self.visits_left = self
            .visits_left
            .checked_sub(1)
            .ok_or(CompileError::TooLarge)?;
        let is_sized = self.layout.is_xcdr2 && !matches!(ty, Type::Number(_));
        let picks = match ty {
            Type::Struct(_) => Vec::new(),
            _ => self.picks(ty, count, want, place)?,
        };
        self.sized(block, is_sized, |this, block| {
            if count == Count::Sequence {
                block.align(4);
            }
            match ty {
                Type::Number(number) => match count {
                    // Nothing is padded for what is not there.
                    Count::Fixed(0) => {}
                    Count::Fixed(n) if picks.is_empty() => {
                        block.align(number.size());
                        block.skip(n.saturating_mul(number.size()));
                    }
                    Count::Fixed(n) => block.numbers(number, n, picks),
                    Count::Sequence => {
                        let mask = block.mask(number.size());
                        let op = Op::Numbers {
                            number,
                            count,
                            mask,
                            picks,
                        };
                        block.push(op, number.size().min(4));
                    }
                },
                Type::Text => {
                    if count != Count::Fixed(0) {
                        block.align(4);
                        let cache = this.n_caches;
                        this.n_caches += 1;
                        let op = Op::Texts {
                            count,
                            picks,
                            cache,
                        };
                        block.push(op, 1);
                    }
                }
                Type::WideText => {
                    if count != Count::Fixed(0) {
                        block.align(4);
                        block.push(Op::WideTexts(count), 1);
                    }
                }
                Type::Struct(_) => this.each(block, ty, count, want, place)?,
            }
            Ok(())
        })
    }

    /// An array or a sequence of structs.
    fn each(
        &mut self,
        block: &mut Block,
        ty: Type,
        count: Count,
        want: Want<'_>,
        place: Place<'t>,
    ) -> Result<(), CompileError> {
        let everywhere = [(0..usize::MAX, want)];
        let wants = match want {
            Want::Nothing => Vec::new(),
            Want::Node(node) if !node.items.is_empty() => node
                .items
                .iter()
                .map(|(range, child)| {
                    Ok((range.clone(), self.settle(ty, Want::Node(child), place)?))
                })
                .collect::<Result<_, _>>()?,
            _ => everywhere.to_vec(),
        };
        let mut segments = Vec::with_capacity(wants.len());
        for (range, want) in wants {
            let required = match want {
                Want::Node(node) => node.required_scalar(),
                _ => None,
            };
            segments.push(Segment {
                range,
                ops: self.element(ty, want, place)?,
                required,
            });
        }
        segments.sort_by_key(|segment| segment.range.start);
        let others = self.element(ty, Want::Nothing, place)?;
        push_each(block, count, self.types.min_size(ty), segments, others);
        Ok(())
    }

    /// The steps through one element of an array, wherever it lies.
    fn element(
        &mut self,
        ty: Type,
        want: Want<'_>,
        place: Place<'t>,
    ) -> Result<Vec<Op>, CompileError> {
        let mut block = Block::new(self.layout.max_align, 1);
        self.one(&mut block, ty, want, place)?;
        Ok(block.ops)
    }

    /// Steps behind a size in bytes, where the layout has one.
    fn sized(
        &mut self,
        block: &mut Block,
        is_sized: bool,
        steps: impl FnOnce(&mut Self, &mut Block) -> Result<(), CompileError>,
    ) -> Result<(), CompileError> {
        if !is_sized {
            return steps(self, block);
        }
        block.align(4);
        let mut inner = Block::new(self.layout.max_align, self.layout.max_align.min(4));
        steps(self, &mut inner)?;
        block.push(Op::Sized(inner.ops), 1);
        Ok(())
    }

    /// What a leaf takes.
    pub(super) fn pick(&mut self, range: std::ops::Range<usize>, leaf: &Leaf) -> Pick {
        if let Field::Values(target) = leaf.field
            && !self.targets.contains(&target)
        {
            self.targets.push(target);
        }
        Pick {
            range,
            is_required: leaf.is_required_scalar(),
            field: leaf.field,
        }
    }
}

fn push_each(
    block: &mut Block,
    count: Count,
    min_size: usize,
    segments: Vec<Segment>,
    others: Vec<Op>,
) {
    let stride = match others.as_slice() {
        // Elements without a byte hold nothing to take, however many they are said to be.
        _ if min_size == 0 => Some((0, 0)),
        _ if !segments.is_empty() => None,
        [Op::Skip(n)] => Some((0, *n)),
        [Op::Align(mask), Op::Skip(n)] if n & mask == 0 => Some((*mask, *n)),
        _ => None,
    };
    match (stride, count) {
        (_, Count::Fixed(0)) => {}
        (Some((mask, size)), Count::Fixed(n)) => {
            block.align(mask + 1);
            block.skip(size.saturating_mul(n));
        }
        (Some((mask, size)), Count::Sequence) => {
            block.push(Op::SkipSequence { mask, size }, 1);
        }
        (None, _) => {
            let op = Op::Each {
                count,
                min_size,
                segments,
                others,
            };
            block.push(op, 1);
        }
    }
}
