//! What stands for object stores in a program that is built without them.

use std::io::{self, Read, Seek, SeekFrom};

use super::{About, Object};

fn refused<T>(address: &str) -> io::Result<T> {
    Err(io::Error::new(
        io::ErrorKind::Unsupported,
        format!(
            "{address} is in an object store, which this program was built without: build it with \
             `cargo build --release --features cloud`"
        ),
    ))
}

pub(crate) fn list(address: &str) -> io::Result<Vec<Object>> {
    refused(address)
}

pub(crate) fn about(addresses: &[&str]) -> Vec<io::Result<About>> {
    addresses.iter().map(|address| refused(address)).collect()
}

/// There is none.
pub(crate) enum RemoteFile {}

impl RemoteFile {
    pub(crate) fn open(address: &str) -> io::Result<Self> {
        refused(address)
    }

    pub(crate) fn size(&self) -> u64 {
        match *self {}
    }
}

impl Read for RemoteFile {
    fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
        match *self {}
    }
}

impl Seek for RemoteFile {
    fn seek(&mut self, _: SeekFrom) -> io::Result<u64> {
        match *self {}
    }
}
