//! Appends a session and its entries to a file.

use crate::frame::{Entry, FrameRef, Session};
use crate::mark::{MARK, check_version};
use rustix::fs::{FlockOperation, OFlags, fcntl_setfl, flock};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

const BUFFER_BYTES: usize = 1 << 18;

/// Writes one session; buffered.
#[derive(Debug)]
pub struct Writer {
    file: BufWriter<File>,
    frame: Vec<u8>,
}

impl Writer {
    /// Opens or makes the file and appends the session.
    ///
    /// # Errors
    /// The system's reason, or the file is something else than a record of this version.
    pub fn append(path: &Path, session: &Session) -> io::Result<Self> {
        let file = BufWriter::with_capacity(BUFFER_BYTES, open_to_append(path)?);
        let mut writer = Self { file, frame: Vec::new() };
        writer.file.write_all(MARK)?;
        writer.write(&FrameRef::Session(session))?;
        writer.flush()?;
        Ok(writer)
    }

    /// Adds an entry to the session.
    ///
    /// # Errors
    /// The system's reason. Later frames would follow half a frame, so a reader would not find them.
    pub fn push(&mut self, entry: &Entry) -> io::Result<()> {
        self.write(&FrameRef::Entry(entry))
    }

    /// Hands the buffer to the system.
    ///
    /// # Errors
    /// The system's reason.
    pub fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }

    /// Waits until the disk has what was flushed.
    ///
    /// # Errors
    /// The system's reason; `InvalidInput` for a pipe or a special file, which cannot be synced.
    pub fn sync(&self) -> io::Result<()> {
        self.file.get_ref().sync_all()
    }

    fn write(&mut self, frame: &FrameRef<'_>) -> io::Result<()> {
        self.frame.clear();
        self.frame = postcard::to_extend(frame, std::mem::take(&mut self.frame)).map_err(io::Error::other)?;
        let length = u32::try_from(self.frame.len()).map_err(io::Error::other)?;
        self.file.write_all(&length.to_le_bytes())?;
        self.file.write_all(&crc32fast::hash(&self.frame).to_le_bytes())?;
        self.file.write_all(&self.frame)
    }
}

/// Accepts a record of this version, an empty file, or a pipe with a reader.
fn open_to_append(path: &Path) -> io::Result<File> {
    // A pipe without a reader is refused: opening it would wait.
    let flags = OFlags::NONBLOCK | OFlags::CLOEXEC;
    let mut options = OpenOptions::new();
    options.append(true).create(true).mode(0o600).custom_flags(flags.bits() as i32);
    let file = options.open(path)?;
    fcntl_setfl(&file, OFlags::APPEND)?;
    if !file.metadata()?.is_file() {
        return Ok(file);
    }
    let mut start = Vec::new();
    File::open(path)?.take(MARK.len() as u64).read_to_end(&mut start)?;
    check_version(&start)?;
    if !start.is_empty() && !MARK.starts_with(&start) {
        return Err(io::Error::other("it is no flight record, and would be spoiled"));
    }
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Err(rustix::io::Errno::WOULDBLOCK) => Err(io::Error::other("another service writes it")),
        locked => locked.map(|()| file).map_err(io::Error::from),
    }
}
