//! What stands for object stores in a program that is built without them.

use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

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

pub(crate) fn read_all(objects: &[Object]) -> Vec<io::Result<Vec<u8>>> {
    objects.iter().map(|o| refused(&o.address)).collect()
}

pub(crate) fn check_writable(address: &str) -> io::Result<()> {
    refused(address)
}

pub(crate) fn put(address: &str, _: &Path) -> io::Result<()> {
    refused(address)
}

pub(crate) fn put_new(address: &str, _: &[u8]) -> io::Result<()> {
    refused(address)
}

pub(crate) fn delete(address: &str) -> io::Result<()> {
    refused(address)
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
