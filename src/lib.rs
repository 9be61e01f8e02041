//! `coact` finds **co**mposite **act**ions in recordings of agents.
//!
//! ```text
//!  .mcap files ──> recording ──> Episode ──> extraction ──> Extraction ──> tables ──> Parquet parts
//!  (dirs, globs)   records,      actions     per episode,    masks,        Arrow       segments/ steps/
//!                  decode,       states      per joint       segments      batches     episodes/ recordings/
//!                  align, split  times       (rayon)
//! ```
//!
//! Modules in reading order: [`model`] holds the words, [`extraction`] the method, [`recording`] the reader,
//! [`tables`] the writer, [`events`] what viewers show, [`results`] reads tables back for [`show`], [`diff`] and
//! [`report`], [`summary`] is what a run tells at its end, [`pipeline`] joins them, [`cli`] is what a user types.

pub mod model;

pub mod extraction;

pub mod recording;

mod cloud;

mod storage;

mod text;

pub mod tables;

pub mod events;

pub mod results;

pub mod show;

pub mod diff;

pub mod report;

pub mod summary;

pub mod pipeline;

pub mod cli;
