//! The ids of episodes that are closed. A recording may have millions, over days: integers that follow each other are
//! kept as ranges.

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

use super::step::IdRef;

/// A set of ids.
#[derive(Debug, Default)]
pub(crate) struct ClosedIds {
    /// First to last of each range; no two of them touch.
    ranges: BTreeMap<i64, i64>,
    texts: HashSet<Arc<str>>,
}

impl ClosedIds {
    pub(crate) fn contains(&self, id: IdRef<'_>) -> bool {
        match id {
            IdRef::None => false,
            IdRef::Integer(id) => self.range_before(id).is_some_and(|(_, last)| id <= last),
            IdRef::Text(id) => self.texts.contains(id),
        }
    }

    pub(crate) fn insert_text(&mut self, id: Arc<str>) {
        self.texts.insert(id);
    }

    pub(crate) fn insert_integer(&mut self, id: i64) {
        if self.contains(IdRef::Integer(id)) {
            return;
        }
        let next = id.checked_add(1);
        let last = next
            .and_then(|next| self.ranges.remove(&next))
            .unwrap_or(id);
        match self.range_before(id) {
            Some((first, before)) if before.checked_add(1) == Some(id) => {
                self.ranges.insert(first, last);
            }
            _ => {
                self.ranges.insert(id, last);
            }
        }
    }

    /// The last range that begins at `id` or before it.
    fn range_before(&self, id: i64) -> Option<(i64, i64)> {
        let range = self.ranges.range(..=id).next_back();
        range.map(|(&first, &last)| (first, last))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_in_any_order_are_a_set_and_neighbours_one_range() {
        let mut closed = ClosedIds::default();
        let ids = [5, 3, 4, i64::MAX, i64::MIN, 9, 8, 3, -1, 0];
        for (n, id) in ids.into_iter().enumerate() {
            closed.insert_integer(id);
            for candidate in [-2, -1, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, i64::MIN, i64::MAX] {
                let is_in = ids[..=n].contains(&candidate);
                assert_eq!(
                    closed.contains(IdRef::Integer(candidate)),
                    is_in,
                    "{candidate}"
                );
            }
        }
        let ranges: Vec<(i64, i64)> = closed.ranges.into_iter().collect();
        let ends = [
            (i64::MIN, i64::MIN),
            (-1, 0),
            (3, 5),
            (8, 9),
            (i64::MAX, i64::MAX),
        ];
        assert_eq!(ranges, ends);
    }
}
