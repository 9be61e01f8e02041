//! What recordings hold, and the command lines that read them.

use std::path::PathBuf;
use std::sync::Arc;

use rayon::prelude::*;
use serde::Serialize;

use super::config::RunError;
use super::inputs::{self, Input};
use crate::recording::{self, Inspection, ReadOptions, quoted};

/// A recording and the command line that reads it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspected {
    /// What it holds.
    #[serde(flatten)]
    pub inspection: Inspection,
    /// A command line that reads it, as it stands.
    pub command: Option<String>,
}

/// Looks into all recordings below `arguments`, in the order of their names.
///
/// # Errors
/// If there is none.
pub fn inspect(arguments: &[PathBuf]) -> Result<Vec<Inspected>, RunError> {
    let inputs = inputs::find(arguments)?;
    Ok(inputs.par_iter().map(inspected).collect())
}

fn inspected(input: &Input) -> Inspected {
    let name = Arc::clone(&input.name);
    let mut inspection = match &input.problem {
        Some(problem) => Inspection::unreadable(name, &input.files, problem),
        None => recording::inspect(name, &input.files, &ReadOptions::default()),
    };
    inspection.bytes = inspection.bytes.max(input.bytes());
    let flags = inspection.flags.as_ref();
    let mut path = quoted(&input.path.to_string_lossy());
    if path.starts_with('-') {
        path = format!("./{path}");
    }
    let command = flags.map(|flags| format!("coact extract {path} -o out {flags}"));
    Inspected {
        inspection,
        command,
    }
}
