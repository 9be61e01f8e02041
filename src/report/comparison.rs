//! Measures side by side, as `coact compare --json` gives them.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::error::ReportError;

/// A comparison of measures; of fields that are not known here nothing is shown.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub(super) struct Comparison {
    measures: Vec<MeasureRow>,
    #[serde(default)]
    agreement: Vec<AgreementRow>,
    #[serde(default)]
    tolerance_steps: Option<u64>,
}

/// What one measure finds in one environment.
#[derive(Debug, Clone, Deserialize, Serialize)]
struct MeasureRow {
    measure: String,
    #[serde(default)]
    profile: Option<String>,
    environment: String,
    n_episodes: u64,
    mean_segments: Option<f64>,
    mean_length: Option<f64>,
    mean_steps: Option<f64>,
    #[serde(default)]
    seconds: Option<f64>,
}

/// How far two measures cut at the same steps.
#[derive(Debug, Clone, Deserialize, Serialize)]
struct AgreementRow {
    environment: String,
    a: String,
    #[serde(default)]
    a_profile: Option<String>,
    b: String,
    #[serde(default)]
    b_profile: Option<String>,
    f1: Option<f64>,
}

impl Comparison {
    pub(super) fn read(path: &Path) -> Result<Self, ReportError> {
        let wrong = |what: String| ReportError::Comparison {
            path: path.to_owned(),
            what,
        };
        let text = std::fs::read(path).map_err(|e| wrong(format!("cannot be read: {e}")))?;
        serde_json::from_slice(&text)
            .map_err(|e| wrong(format!("is not what coact compare --json prints: {e}")))
    }
}
