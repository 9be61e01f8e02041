//! The house's one rule: `cli → pipeline → {recording, extraction, tables, events, summary} → model`, held as data.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Each module and what it may import from the crate.
const MAY_IMPORT: &[(&str, &[&str])] = &[
    (
        "main",
        &[
            "cli", "pipeline", "results", "show", "diff", "report", "summary",
        ],
    ),
    (
        "cli",
        &[
            "pipeline",
            "extraction",
            "recording",
            "results",
            "show",
            "diff",
            "report",
            "text",
            "model",
        ],
    ),
    (
        "pipeline",
        &[
            "recording",
            "extraction",
            "tables",
            "events",
            "summary",
            "cloud",
            "model",
        ],
    ),
    ("summary", &["text", "model"]),
    ("text", &[]),
    ("recording", &["cloud", "model"]),
    ("cloud", &[]),
    ("extraction", &["model"]),
    ("tables", &["storage", "model"]),
    ("events", &["storage", "model"]),
    ("storage", &["cloud"]),
    ("results", &["tables", "model"]),
    ("show", &["results", "text", "model"]),
    ("diff", &["results", "text", "model"]),
    ("report", &["results", "model"]),
    ("model", &[]),
    ("lib", &[]),
];

/// What the pure core must not touch.
const BANNED_IN_EXTRACTION: &[&str] = &[
    "std::fs",
    "std::io",
    "std::time",
    "std::env",
    "mcap::",
    "parquet::",
    "arrow::",
    "tracing::",
    "println!",
    "eprintln!",
];

fn sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut folders = vec![root.clone()];
    let mut files: Vec<PathBuf> = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
        .into_iter()
        .map(|path| {
            let relative = path.strip_prefix(&root).unwrap();
            let module = relative
                .components()
                .next()
                .unwrap()
                .as_os_str()
                .to_str()
                .unwrap()
                .trim_end_matches(".rs");
            (module.to_owned(), std::fs::read_to_string(&path).unwrap())
        })
        .collect()
}

/// Code without comments, and without the tests at the end of a file.
fn code(text: &str) -> String {
    let text = text.split("#[cfg(test)]").next().unwrap_or("");
    text.lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .collect::<Vec<_>>()
        .join("\n")
}

/// The top modules that `code` names behind `prefix`, also in grouped imports.
fn imported(code: &str, prefix: &str) -> BTreeSet<String> {
    let mut modules = BTreeSet::new();
    for (at, _) in code.match_indices(prefix) {
        let rest = &code[at + prefix.len()..];
        let names: Vec<&str> = match rest.strip_prefix('{') {
            Some(group) => top_level_names(group),
            None => vec![rest],
        };
        for name in names {
            let name: String = name
                .trim_start()
                .chars()
                .take_while(|c| c.is_alphanumeric() || *c == '_')
                .collect();
            modules.insert(name);
        }
    }
    modules
}

/// The names of a group `{a::b, c::{d, e}, f}` at its own depth.
fn top_level_names(group: &str) -> Vec<&str> {
    let (mut depth, mut start, mut names) = (0, 0, Vec::new());
    for (i, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => {
                names.push(&group[start..i]);
                break;
            }
            '}' => depth -= 1,
            ',' if depth == 0 => {
                names.push(&group[start..i]);
                start = i + 1;
            }
            _ => {}
        }
    }
    names
}

fn breaches(module: &str, text: &str) -> Vec<String> {
    let code = code(text);
    let allowed = MAY_IMPORT
        .iter()
        .find(|(m, _)| *m == module)
        .map(|(_, a)| *a);
    let Some(allowed) = allowed else {
        return vec![format!("module {module} is not in the import table")];
    };
    let prefix = if module == "main" {
        "coact::"
    } else {
        "crate::"
    };
    let mut found: Vec<String> = imported(&code, prefix)
        .into_iter()
        .filter(|name| !name.is_empty() && name != module && !allowed.contains(&name.as_str()))
        .map(|name| format!("{module} imports {name}"))
        .collect();
    if module == "extraction" {
        found.extend(
            BANNED_IN_EXTRACTION
                .iter()
                .filter(|b| code.contains(**b))
                .map(|b| format!("extraction uses {b}")),
        );
    }
    found
}

#[test]
fn modules_import_only_what_the_table_allows() {
    let sources = sources();
    assert!(sources.len() > 20, "the sources were found");
    let found: Vec<String> = sources
        .iter()
        .flat_map(|(module, text)| breaches(module, text))
        .collect();
    assert!(found.is_empty(), "{found:#?}");
}

#[test]
fn a_breach_is_found() {
    assert_eq!(
        breaches("extraction", "use crate::{model::Episode, tables};"),
        ["extraction imports tables"]
    );
    assert_eq!(
        breaches("recording", "fn f() { crate::extraction::extract() }"),
        ["recording imports extraction"]
    );
    assert_eq!(
        breaches("extraction", "let x = std::fs::read(p);"),
        ["extraction uses std::fs"]
    );
    assert_eq!(
        breaches("newcomer", ""),
        ["module newcomer is not in the import table"]
    );
    assert!(
        breaches(
            "tables",
            "// use crate::recording;\nuse crate::model::Episode;"
        )
        .is_empty()
    );
}
