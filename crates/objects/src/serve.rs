//! What the program `atsplat-objects` does: answers requests about one URL.

use std::io::{BufRead, Write};
use std::sync::{Mutex, PoisonError};

use atsplat_files::FileError;

use crate::ObjectError;
use crate::storage::connected::Connected;
use crate::storage::{Answer, Call, Content, Request, Storage, Version};

/// Answers the requests of `input` until it ends, each on a separate thread. The error of a URL that cannot be used is the answer to all.
///
/// # Errors
/// [`ObjectError::Io`] for a line that is not a request, and for an input that cannot be read.
pub fn serve(url: &str, input: impl BufRead, output: impl Write + Send) -> Result<(), ObjectError> {
    let opened = Connected::open(url);
    let output = Mutex::new(output);
    std::thread::scope(|scope| {
        for line in input.lines() {
            let line = line.map_err(FileError::during::<ObjectError>("reading requests", url.to_owned()))?;
            let request = serde_json::from_str::<Request>(&line).map_err(std::io::Error::from);
            let Request { id, call } =
                request.map_err(FileError::during::<ObjectError>("reading a request", url.to_owned()))?;
            match &opened {
                Ok(storage) => drop(scope.spawn({
                    let output = &output;
                    move || answer(storage, id, call, output)
                })),
                Err(error) => send(&output, id, Content::Failed(error.clone()), None),
            }
        }
        Ok(())
    })
}

fn answer(storage: &Connected, id: u64, call: Call, output: &Mutex<impl Write + Send>) {
    let each = |name: &str, version: Version| {
        send(output, id, Content::Each(name.to_owned(), version), Some(storage));
        Ok(())
    };
    let content = match call {
        Call::List => storage.list().map(Content::Objects),
        Call::Download(downloads) => storage.download(downloads, &each).map(|()| Content::Done),
        Call::Get(name) => storage.get(&name).map(Content::Text),
        Call::Put(uploads) => storage.put(uploads, &each).map(|()| Content::Done),
        Call::Delete(name) => storage.delete(&name).map(|()| Content::Done),
    };
    send(output, id, content.unwrap_or_else(Content::Failed), Some(storage));
}

fn send(output: &Mutex<impl Write + Send>, id: u64, content: Content, storage: Option<&Connected>) {
    let mut output = output.lock().unwrap_or_else(PoisonError::into_inner);
    // Behind the lock, so that no answer has older counts than the one before.
    let traffic = storage.map(Storage::traffic).unwrap_or_default();
    let Ok(mut line) = serde_json::to_vec(&Answer { id, traffic, content }) else { return };
    line.push(b'\n');
    // Nobody waits for an answer behind a closed pipe.
    output.write_all(&line).and_then(|()| output.flush()).ok();
}
