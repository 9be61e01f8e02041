//! Collects rows as they are decoded and hands them on column by column.

use crate::model::Columns;

/// Rows kept back before they are transposed: enough that each column is written a few cache lines at a time.
const BLOCK_ROWS: usize = 32;

/// Memory that is taken before the rows are there, bytes.
const MAX_RESERVED: usize = 16 << 20;

/// Grows by rows of equal width, ends as [`Columns`].
#[derive(Debug, Default)]
pub(crate) struct ColumnsBuilder {
    width: usize,
    columns: Vec<Vec<f64>>,
    /// Row-major, at most [`BLOCK_ROWS`] rows that are not in `columns` yet.
    block: Vec<f64>,
    n_rows: usize,
}

impl ColumnsBuilder {
    /// Expects about `n_rows` rows: columns that need not grow are not copied.
    pub(crate) fn new(width: usize, n_rows: usize) -> Self {
        let capacity = n_rows.min(MAX_RESERVED / (8 * width.max(1)));
        Self {
            width,
            columns: (0..width).map(|_| Vec::with_capacity(capacity)).collect(),
            block: Vec::with_capacity(width * BLOCK_ROWS),
            n_rows: 0,
        }
    }

    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Bytes of the values held.
    pub(crate) fn bytes(&self) -> u64 {
        (self.n_rows as u64) * (self.width as u64) * 8
    }

    /// Appends one row of `width` values.
    pub(crate) fn push(&mut self, row: &[f64]) {
        debug_assert_eq!(row.len(), self.width);
        self.block.extend_from_slice(row);
        self.n_rows += 1;
        if self.block.len() >= self.width * BLOCK_ROWS {
            self.flush();
        }
    }

    fn flush(&mut self) {
        if self.block.is_empty() {
            return;
        }
        let mut rows = [self.block.as_slice(); BLOCK_ROWS];
        let n_rows = self.block.len() / self.width;
        for (row, of_block) in rows.iter_mut().zip(self.block.chunks_exact(self.width)) {
            *row = of_block;
        }
        let mut values = [0.0; BLOCK_ROWS];
        for (c, column) in self.columns.iter_mut().enumerate() {
            for (value, row) in values.iter_mut().zip(&rows) {
                *value = row[c];
            }
            column.extend_from_slice(&values[..n_rows]);
        }
        self.block.clear();
    }

    /// The first `n` rows, or with `order` the rows of these indices in this order.
    pub(crate) fn finish(mut self, n: usize, order: Option<&[usize]>) -> Columns {
        self.flush();
        let n = n.min(self.n_rows);
        let columns = match order {
            None => {
                for column in &mut self.columns {
                    column.truncate(n);
                }
                self.columns
            }
            Some(order) => self
                .columns
                .iter()
                .map(|column| order[..n].iter().map(|&i| column[i]).collect())
                .collect(),
        };
        Columns::new(n, columns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn built(n_rows: usize) -> ColumnsBuilder {
        let mut builder = ColumnsBuilder::new(2, 0);
        for i in 0..n_rows {
            builder.push(&[i as f64, -(i as f64)]);
        }
        builder
    }

    #[test]
    fn rows_come_out_as_columns_whatever_the_block() {
        for n in [0, 1, 15, 16, 17, 33] {
            let columns = built(n).finish(n, None);
            let expected: Vec<f64> = (0..n).map(|i| i as f64).collect();
            assert_eq!(columns.column(0), expected);
            assert_eq!(columns.n_rows(), n);
        }
    }

    #[test]
    fn an_order_picks_rows() {
        assert_eq!(
            built(20).finish(3, Some(&[19, 0, 7])).column(1),
            [-19.0, 0.0, -7.0]
        );
    }
}
