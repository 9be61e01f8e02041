#![no_main]
#![allow(dead_code)] // each target runs one function of the harness

#[path = "../harness.rs"]
mod harness;

libfuzzer_sys::fuzz_target!(|data: &[u8]| harness::run("options", data));
