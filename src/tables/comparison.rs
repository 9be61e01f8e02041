//! A comparison of measures as one Parquet file.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use arrow::array::{
    ArrayRef, Float64Array, Float64Builder, Int64Array, ListBuilder, RecordBatch, StringArray,
    StringBuilder, StructBuilder,
};
use arrow::datatypes::{DataType, Field, Fields, Schema};
use parquet::arrow::ArrowWriter;

use super::directory::temporary_name;
use super::error::TableError;
use crate::model::{Comparison, MeasureRow};
use crate::storage::Storage;

/// Writes one row a measure and environment, with its agreement with each other measure; whole or not at all.
///
/// # Errors
/// If the file system refuses.
pub fn write_comparison(path: &Path, comparison: &Comparison) -> Result<(), TableError> {
    let batch = batch(comparison).map_err(|e| TableError::parquet(path)(e.into()))?;
    let mut writer = ArrowWriter::try_new(Vec::new(), batch.schema(), None)
        .map_err(TableError::parquet(path))?;
    let bytes = writer
        .write(&batch)
        .and_then(|()| writer.into_inner())
        .map_err(TableError::parquet(path))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let temporary = path.with_file_name(temporary_name(&name));
    Storage::default().write_whole(path, &temporary, &bytes)?;
    Ok(())
}

fn batch(comparison: &Comparison) -> Result<RecordBatch, arrow::error::ArrowError> {
    let rows = &comparison.measures;
    let text = |of: &dyn Fn(&MeasureRow) -> String| -> ArrayRef {
        Arc::new(StringArray::from_iter_values(rows.iter().map(of)))
    };
    let numbers = |of: &dyn Fn(&MeasureRow) -> Option<f64>| -> ArrayRef {
        Arc::new(rows.iter().map(of).collect::<Float64Array>())
    };
    let n_episodes = rows
        .iter()
        .map(|r| i64::try_from(r.n_episodes).unwrap_or(i64::MAX));
    let columns = [
        text(&|r| r.environment.to_string()),
        text(&|r| r.measure.to_owned()),
        text(&|r| r.profile.to_owned()),
        Arc::new(Int64Array::from_iter_values(n_episodes)),
        numbers(&|r| Some(r.mean_segments)),
        numbers(&|r| r.mean_length),
        numbers(&|r| Some(r.mean_steps)),
        numbers(&|r| Some(r.seconds)),
        agreement(comparison),
    ];
    RecordBatch::try_new(Arc::new(schema(comparison.tolerance_steps)), columns.into())
}

fn schema(tolerance_steps: usize) -> Schema {
    let field = |name: &str, kind: DataType, nullable: bool, meaning: &str| {
        Field::new(name, kind, nullable).with_metadata(HashMap::from([(
            "description".to_owned(),
            meaning.to_owned(),
        )]))
    };
    let (text, number) = (DataType::Utf8, DataType::Float64);
    let item = Field::new("item", DataType::Struct(agreement_fields()), false);
    let within =
        format!("F1 of boundaries within {tolerance_steps} steps, with each other measure");
    Schema::new(vec![
        field(
            "environment",
            text.clone(),
            false,
            "env_id, else the folder of the recording",
        ),
        field("measure", text.clone(), false, "name of the measure"),
        field("profile", text, false, "paper or authors"),
        field(
            "n_episodes",
            DataType::Int64,
            false,
            "episodes, also those that gave nothing",
        ),
        field(
            "mean_segments",
            number.clone(),
            false,
            "composite actions an episode, over all joints",
        ),
        field(
            "mean_length",
            number.clone(),
            true,
            "steps of a composite action",
        ),
        field("mean_steps", number.clone(), false, "steps of an episode"),
        field("seconds", number, false, "time of extraction, all threads"),
        field("agreement", DataType::List(Arc::new(item)), false, &within),
    ])
    .with_metadata(HashMap::from([(
        "coact.tolerance_steps".to_owned(),
        tolerance_steps.to_string(),
    )]))
}

fn agreement_fields() -> Fields {
    Fields::from(vec![
        Field::new("measure", DataType::Utf8, false),
        Field::new("profile", DataType::Utf8, false),
        Field::new("f1", DataType::Float64, false),
    ])
}

/// For each row, how far it agrees with each other one of its environment.
fn agreement(comparison: &Comparison) -> ArrayRef {
    let fields = agreement_fields();
    let item = Field::new("item", DataType::Struct(fields.clone()), false);
    let structs = StructBuilder::new(
        fields,
        vec![
            Box::new(StringBuilder::new()),
            Box::new(StringBuilder::new()),
            Box::new(Float64Builder::new()),
        ],
    );
    let mut lists = ListBuilder::new(structs).with_field(item);
    for row in &comparison.measures {
        let is_row = |name, profile| (name, profile) == (row.measure, row.profile);
        let of_environment = comparison.agreement.iter();
        for pair in of_environment.filter(|pair| pair.environment == row.environment) {
            let (name, profile) = if is_row(pair.a, pair.a_profile) {
                (pair.b, pair.b_profile)
            } else if is_row(pair.b, pair.b_profile) {
                (pair.a, pair.a_profile)
            } else {
                continue;
            };
            let values = lists.values();
            for (column, value) in [name, profile].into_iter().enumerate() {
                if let Some(texts) = values.field_builder::<StringBuilder>(column) {
                    texts.append_value(value);
                }
            }
            if let Some(numbers) = values.field_builder::<Float64Builder>(2) {
                numbers.append_value(pair.f1);
            }
            values.append(true);
        }
        lists.append(true);
    }
    Arc::new(lists.finish())
}
