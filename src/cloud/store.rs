//! Requests to object stores: listing, and ranges that arrive whole or not at all.

use std::collections::BTreeMap;
use std::future::Future;
use std::io;
use std::ops::Range;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::time::Duration;

use futures_util::{StreamExt, TryStreamExt, stream};
use object_store::path::Path;
use object_store::{Error, GetOptions, GetRange, ObjectMeta, ObjectStore, parse_url_opts};
use tokio::runtime::{Builder, Runtime};
use url::Url;

use super::{About, Object};

/// Threads for requests: they wait, and copy bytes.
const THREADS: usize = 2;

/// Requests for sizes that are under way at a time.
const MANY: usize = 32;

/// How often a range is asked for again without a byte more of it, and how long to wait before.
pub(super) const TRIES: u32 = 6;
pub(super) const PAUSE: Duration = Duration::from_millis(100);

/// An object, found.
#[derive(Clone)]
pub(super) struct Location {
    pub(super) store: Arc<dyn ObjectStore>,
    pub(super) path: Path,
}

/// Runs requests to their end; only for threads that are not those of the requests.
pub(super) fn wait<T>(requests: impl Future<Output = T>) -> io::Result<T> {
    Ok(runtime()?.block_on(requests))
}

pub(super) fn runtime() -> io::Result<&'static Runtime> {
    static RUNTIME: LazyLock<io::Result<Runtime>> = LazyLock::new(|| {
        Builder::new_multi_thread()
            .worker_threads(THREADS)
            .thread_name("coact-cloud")
            .enable_all()
            .build()
    });
    RUNTIME
        .as_ref()
        .map_err(|e| io::Error::new(e.kind(), format!("cannot start threads for requests: {e}")))
}

/// Recordings and whatever else is below an address, in the order of their names.
pub(crate) fn list(address: &str) -> io::Result<Vec<Object>> {
    let Location { store, path } = locate(address)?;
    let (root, _) = split(address)?;
    if root.starts_with("http") {
        return Err(io::Error::new(
            io::ErrorKind::Unsupported,
            "what is below an https:// address cannot be listed: name each recording",
        ));
    }
    let found: Vec<ObjectMeta> = wait(store.list(Some(&path)).try_collect())?.map_err(io_error)?;
    let mut objects: Vec<Object> = found
        .into_iter()
        .map(|meta| Object {
            address: format!("{root}/{}", meta.location),
            about: about_of(&meta),
        })
        .collect();
    objects.sort_by(|a, b| a.address.cmp(&b.address));
    Ok(objects)
}

/// What there is to know of many objects, asked side by side.
pub(crate) fn about(addresses: &[&str]) -> Vec<io::Result<About>> {
    let requests = addresses.iter().map(|address| async {
        let Location { store, path } = locate(address)?;
        let options = GetOptions {
            head: true,
            ..GetOptions::default()
        };
        let found = store.get_opts(&path, options).await.map_err(io_error)?;
        Ok(about_of(&found.meta))
    });
    let all = stream::iter(requests.collect::<Vec<_>>())
        .buffered(MANY)
        .collect();
    wait(all).unwrap_or_else(|e| {
        let failed = || io::Error::new(e.kind(), e.to_string());
        addresses.iter().map(|_| Err(failed())).collect()
    })
}

/// Whole small objects, as they were listed, asked for side by side.
pub(crate) fn read_all(objects: &[Object]) -> Vec<io::Result<Vec<u8>>> {
    let requests = objects.iter().map(|Object { address, about }| async {
        range(&locate(address)?, &about.tag, 0..about.bytes).await
    });
    let all = stream::iter(requests.collect::<Vec<_>>())
        .buffered(MANY)
        .collect();
    wait(all).unwrap_or_else(|e| {
        let failed = || io::Error::new(e.kind(), e.to_string());
        objects.iter().map(|_| Err(failed())).collect()
    })
}

fn about_of(meta: &ObjectMeta) -> About {
    About {
        bytes: meta.size,
        tag: meta
            .e_tag
            .clone()
            .unwrap_or_else(|| meta.last_modified.to_rfc3339()),
    }
}

/// Where an address leads. Connections are shared by all objects of a bucket.
pub(super) fn locate(address: &str) -> io::Result<Location> {
    static STORES: Mutex<BTreeMap<String, Arc<dyn ObjectStore>>> = Mutex::new(BTreeMap::new());
    let (root, key) = split(address)?;
    if root.starts_with("http") {
        // Where a bucket ends is known to the store alone, and depends on the host.
        let (store, path) = store_of(address)?;
        return Ok(Location { store, path });
    }
    let path = Path::parse(key).map_err(|e| io_error(e.into()))?;
    let mut stores = STORES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(store) = stores.get(root) {
        let store = Arc::clone(store);
        return Ok(Location { store, path });
    }
    let (store, _) = store_of(root)?;
    stores.insert(root.to_owned(), Arc::clone(&store));
    Ok(Location { store, path })
}

/// The store with its bucket, and the name in it.
pub(super) fn split(address: &str) -> io::Result<(&str, &str)> {
    let invalid = |what: String| io::Error::new(io::ErrorKind::InvalidInput, what);
    let (scheme, rest) = address.split_once("://").unwrap_or_default();
    if !["s3", "gs", "az", "https"].contains(&scheme) {
        return Err(invalid(format!(
            "{scheme}:// is no store that is known: expected s3://, gs://, az:// or https://"
        )));
    }
    let bucket = rest.split('/').next().unwrap_or_default();
    if bucket.is_empty() {
        return Err(invalid(format!("{address} names no bucket")));
    }
    let root = &address[..scheme.len() + "://".len() + bucket.len()];
    Ok((root, rest[bucket.len()..].trim_matches('/')))
}

/// A store, with what its own tools take from the environment, too.
fn store_of(address: &str) -> io::Result<(Arc<dyn ObjectStore>, Path)> {
    let url = Url::parse(address)
        .map_err(|e| io::Error::new(io::ErrorKind::InvalidInput, format!("{address}: {e}")))?;
    let options = std::env::vars_os()
        .filter_map(|(key, value)| Some((key.into_string().ok()?, value.into_string().ok()?)))
        .filter(|(key, _)| {
            ["AWS_", "GOOGLE_", "AZURE_"]
                .iter()
                .any(|p| key.starts_with(p))
        });
    let (store, path) = parse_url_opts(&url, options).map_err(io_error)?;
    Ok((Arc::from(store), path))
}

/// The first bytes of an object, up to `end`, and what is known of it.
pub(super) async fn first_range(location: &Location, end: u64) -> io::Result<(About, Vec<u8>)> {
    let Location { store, path } = location;
    let options = GetOptions {
        head: true,
        ..GetOptions::default()
    };
    let found = store.get_opts(path, options).await.map_err(io_error)?;
    let about = about_of(&found.meta);
    let bytes = range(location, &about.tag, 0..end.min(about.bytes)).await?;
    Ok((about, bytes))
}

/// A range of an object whose content is still the one of `tag`. A connection that is cut is made again, and goes on
/// where it was cut.
pub(super) async fn range(
    location: &Location,
    tag: &str,
    range: Range<u64>,
) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::with_capacity(usize::try_from(range.end - range.start).unwrap_or(0));
    let mut n_tries = 0;
    loop {
        let start = range.start + bytes.len() as u64;
        if start >= range.end {
            return Ok(bytes);
        }
        let n_before = bytes.len();
        let result = append(location, tag, start..range.end, &mut bytes).await;
        n_tries = if bytes.len() > n_before {
            0
        } else {
            n_tries + 1
        };
        match result {
            Err(e) if n_tries >= TRIES || !is_passing(&e) => return Err(io_error(e)),
            Ok(()) if n_tries >= TRIES => return Err(io::ErrorKind::UnexpectedEof.into()),
            _ => {}
        }
        tokio::time::sleep(PAUSE * 2_u32.pow(n_tries)).await;
    }
}

async fn append(
    location: &Location,
    tag: &str,
    range: Range<u64>,
    bytes: &mut Vec<u8>,
) -> Result<(), Error> {
    let end = range.end - range.start + bytes.len() as u64;
    let options = GetOptions {
        // A store that has no tags is not asked for one.
        if_match: Some(tag.to_owned()).filter(|tag| tag.contains('"')),
        range: Some(GetRange::Bounded(range)),
        ..GetOptions::default()
    };
    let found = location.store.get_opts(&location.path, options).await?;
    let mut body = found.into_stream();
    while let Some(piece) = body.next().await {
        bytes.extend_from_slice(&piece?);
        // More than was asked for is no part of the range.
        bytes.truncate(usize::try_from(end).unwrap_or(usize::MAX));
    }
    Ok(())
}

/// May the same request do better the next time?
pub(super) fn is_passing(e: &Error) -> bool {
    matches!(e, Error::Generic { .. })
}

pub(super) fn io_error(e: Error) -> io::Error {
    match e {
        Error::NotFound { .. } => io::Error::new(io::ErrorKind::NotFound, "no such object"),
        Error::AlreadyExists { .. } => {
            io::Error::new(io::ErrorKind::AlreadyExists, "another process was faster")
        }
        Error::Precondition { .. } => {
            io::Error::other("it was replaced while it was read: read it again")
        }
        e => io::Error::other(e),
    }
}
