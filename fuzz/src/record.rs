//! Any bytes as a flight record, or as its frames: no panic, no hang. Every byte is part of a frame or counted as torn, and
//! a replay ends.

use daemon::config::ConfigFile;
use daemon::replay::check;
use daemon::threads::recorder::session;
use flight_record::{Frame, MARK, Reader};
use std::cell::LazyCell;
use std::io::Cursor;

thread_local! {
    static SESSION: LazyCell<Vec<u8>> = const { LazyCell::new(|| {
        let config = ConfigFile::preset("paper-translation").unwrap().config;
        let session = session(&config, "vehicle", None);
        [MARK.as_slice(), &framed(&postcard::to_allocvec(&Frame::Session(Box::new(session))).unwrap())].concat()
    }) };
}

fn framed(body: &[u8]) -> Vec<u8> {
    let length = u32::try_from(body.len()).unwrap();
    [&length.to_le_bytes(), crc32fast::hash(body).to_le_bytes().as_slice(), body].concat()
}

/// Frames and torn bytes; `None` where a mark of another version was refused.
fn read_all(bytes: &[u8]) -> Option<(usize, u64)> {
    let mut reader = Reader::new(Cursor::new(bytes));
    let mut frames = 0;
    while reader.next_frame().ok()?.is_some() {
        frames += 1;
    }
    assert!(reader.torn_bytes() <= bytes.len() as u64);
    Some((frames, reader.torn_bytes()))
}

pub(crate) fn run(bytes: &[u8]) {
    if let Some((frames, torn)) = read_all(bytes) {
        assert!(frames > 0 || torn > 0 || bytes.is_empty() || bytes.chunks(16).all(|chunk| chunk == MARK));
    }
    // As the frames of a session: the two bytes before each are its length, and the check sums are correct.
    let mut record = SESSION.with(|session| (**session).clone());
    let mut rest = bytes;
    let mut n = 1;
    while let Some((length, behind)) = rest.split_first_chunk() {
        let (body, behind) = behind.split_at(usize::from(u16::from_le_bytes(*length)).min(behind.len()));
        record.extend(framed(body));
        rest = behind;
        n += 1;
    }
    let Some((frames, _)) = read_all(&record) else { return };
    assert!((1..=n).contains(&frames));
    // Without an entry there is nothing to replay, and building the engine takes most of a run.
    if frames < 2 {
        return;
    }
    let reports = check(&mut Reader::new(Cursor::new(&record)));
    assert!(reports.is_err() || !reports.unwrap().is_empty());
}
