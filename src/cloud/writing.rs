//! Objects that are written: each is there whole or not at all, and a name that must be free goes to the first.

use std::fs::File;
use std::future::Future;
use std::io::{self, Read};
use std::path::Path as FilePath;
use std::sync::Arc;

use futures_util::stream::{FuturesUnordered, StreamExt};
use object_store::{
    Attribute, Attributes, Error, GetOptions, MultipartUpload, ObjectStore, ObjectStoreExt,
    PutMode, PutMultipartOptions, PutOptions, PutPayload,
};

use super::store::{Location, PAUSE, TRIES, io_error, is_passing, locate, split, wait};
use super::token;

/// Files up to this size go in one request; larger ones in pieces of it, of which any can be sent again.
const PIECE: u64 = 8 << 20;

/// Pieces that are under way at a time.
const UNDER_WAY: usize = 3;

/// In the metadata of an object: which process wrote it. Some stores take letters and digits alone.
const WRITER: &str = "coactwriter";

/// Can objects be written there at all?
pub(crate) fn check_writable(address: &str) -> io::Result<()> {
    let (root, _) = split(address)?;
    if root.starts_with("http") {
        return Err(io::Error::new(
            io::ErrorKind::Unsupported,
            "expected s3://, gs:// or az://",
        ));
    }
    Ok(())
}

/// Writes an object from a file, also over an older one.
pub(crate) fn put(address: &str, file: &FilePath) -> io::Result<()> {
    let location = locate(address)?;
    let bytes = file.metadata()?.len();
    if bytes > PIECE {
        return wait(again(|| in_pieces(&location, file)))?;
    }
    let content = std::fs::read(file)?;
    wait(again(|| {
        whole(&location, content.clone(), PutMode::Overwrite)
    }))?
}

/// Writes an object whose name must be free: where it is taken, the error has the kind `AlreadyExists`, and what stands
/// there stays.
pub(crate) fn put_new(address: &str, content: &[u8]) -> io::Result<()> {
    let location = locate(address)?;
    wait(again(async || {
        match whole(&location, content.to_vec(), PutMode::Create).await {
            Err(Failed::Store(e @ Error::AlreadyExists { .. })) => {
                // An answer that was lost has us ask twice; and a store refuses, too, while another is asking.
                match is_own(&location).await {
                    Ok(true) => Ok(()),
                    Ok(false) => Err(Failed::Store(e)),
                    Err(Error::NotFound { .. }) => Err(Failed::Again),
                    Err(e) => Err(Failed::Store(e)),
                }
            }
            result => result,
        }
    }))?
}

/// Removes an object; that it is gone already is no error.
pub(crate) fn delete(address: &str) -> io::Result<()> {
    let Location { store, path } = &locate(address)?;
    wait(again(async || match store.delete(path).await {
        Err(Error::NotFound { .. }) => Ok(()),
        result => result.map_err(Failed::Store),
    }))?
}

/// Why an object was not written.
enum Failed {
    Store(Error),
    /// The file that it comes from cannot be read.
    File(io::Error),
    /// The store could not tell: to be asked again.
    Again,
}

/// Asks again as long as that may help.
async fn again<F: Future<Output = Result<(), Failed>>>(ask: impl Fn() -> F) -> io::Result<()> {
    let mut n_tries = 0;
    loop {
        let failed = match ask().await {
            Ok(()) => return Ok(()),
            Err(failed) => failed,
        };
        n_tries += 1;
        let is_last = n_tries >= TRIES;
        match failed {
            Failed::File(e) => return Err(e),
            Failed::Again if is_last => return Err(io::ErrorKind::ResourceBusy.into()),
            Failed::Store(e) if is_last || !is_passing(&e) => return Err(io_error(e)),
            Failed::Again | Failed::Store(_) => {}
        }
        tokio::time::sleep(PAUSE * 2_u32.pow(n_tries)).await;
    }
}

async fn whole(location: &Location, content: Vec<u8>, mode: PutMode) -> Result<(), Failed> {
    let options = PutOptions {
        mode,
        attributes: attributes(),
        ..PutOptions::default()
    };
    let payload = PutPayload::from(content);
    let put = location.store.put_opts(&location.path, payload, options);
    put.await.map(|_| ()).map_err(Failed::Store)
}

/// The object has its name once all pieces are there.
async fn in_pieces(location: &Location, file: &FilePath) -> Result<(), Failed> {
    let options = PutMultipartOptions {
        attributes: attributes(),
        ..PutMultipartOptions::default()
    };
    let store: &Arc<dyn ObjectStore> = &location.store;
    let mut upload = store
        .put_multipart_opts(&location.path, options)
        .await
        .map_err(Failed::Store)?;
    let sent = match send(&mut *upload, file).await {
        Ok(()) => upload.complete().await.map_err(Failed::Store),
        Err(failed) => Err(failed),
    };
    match sent {
        Ok(_) => Ok(()),
        Err(failed) => {
            // What stays of it has no name; stores can be told to drop such after days.
            let _best_effort: Result<(), Error> = upload.abort().await;
            Err(failed)
        }
    }
}

async fn send(upload: &mut dyn MultipartUpload, file: &FilePath) -> Result<(), Failed> {
    let mut file = File::open(file).map_err(Failed::File)?;
    let mut under_way = FuturesUnordered::new();
    loop {
        let mut piece = Vec::new();
        let n = (&mut file).take(PIECE).read_to_end(&mut piece);
        if n.map_err(Failed::File)? == 0 {
            break;
        }
        under_way.push(upload.put_part(piece.into()));
        if under_way.len() >= UNDER_WAY
            && let Some(sent) = under_way.next().await
        {
            sent.map_err(Failed::Store)?;
        }
    }
    while let Some(sent) = under_way.next().await {
        sent.map_err(Failed::Store)?;
    }
    Ok(())
}

fn attributes() -> Attributes {
    Attributes::from_iter([(Attribute::Metadata(WRITER.into()), token())])
}

/// Did this process write what stands there?
async fn is_own(location: &Location) -> Result<bool, Error> {
    let options = GetOptions {
        head: true,
        ..GetOptions::default()
    };
    let found = location.store.get_opts(&location.path, options).await?;
    let writer = found.attributes.get(&Attribute::Metadata(WRITER.into()));
    Ok(writer.is_some_and(|writer| **writer == *token()))
}
