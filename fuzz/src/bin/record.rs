//! Any bytes as a flight record, and any bytes in the place of a whole one's: no panic, no hang, every byte is part of
//! a frame or counted as torn, and a replay ends.

#![no_main]

use daemon::config::ConfigFile;
use daemon::record::{Frame, Reader, Session, check};
use libfuzzer_sys::fuzz_target;
use std::cell::LazyCell;
use std::io::Cursor;

const MARK: &[u8; 16] = b"\xff\xff\xff\xffflight-rec2\n";

thread_local! {
    static SESSION: LazyCell<Vec<u8>> = const { LazyCell::new(|| {
        let config = ConfigFile::preset("paper-translation").unwrap().config;
        let session = Session::of(&config, "vehicle", None);
        [MARK.as_slice(), &framed(&postcard::to_allocvec(&Frame::Session(Box::new(session))).unwrap())].concat()
    }) };
}

fn framed(body: &[u8]) -> Vec<u8> {
    let length = u32::try_from(body.len()).unwrap();
    [&length.to_le_bytes(), crc32fast::hash(body).to_le_bytes().as_slice(), body].concat()
}

fn read_all(bytes: &[u8]) -> (usize, u64) {
    let mut reader = Reader::new(Cursor::new(bytes));
    let mut frames = 0;
    while let Ok(Some(_)) = reader.next_frame() {
        frames += 1;
    }
    assert!(reader.torn_bytes() <= bytes.len() as u64);
    (frames, reader.torn_bytes())
}

fuzz_target!(|bytes: &[u8]| {
    let (frames, torn) = read_all(bytes);
    assert!(frames > 0 || torn > 0 || bytes.is_empty() || bytes.chunks(16).all(|chunk| chunk == MARK));
    // As the frames of a session, each of a length that its first byte tells, with sums that fit.
    let mut record = SESSION.with(|session| (**session).clone());
    let mut rest = bytes;
    let mut n = 1;
    while let Some((&length, behind)) = rest.split_first() {
        let (body, behind) = behind.split_at(usize::from(length).min(behind.len()));
        record.extend(framed(body));
        rest = behind;
        n += 1;
    }
    let (frames, _) = read_all(&record);
    assert!((1..=n).contains(&frames));
    // Without an entry there is nothing to replay, and building the engine takes most of a run.
    if frames < 2 {
        return;
    }
    let reports = check(&mut Reader::new(Cursor::new(&record)));
    assert!(reports.is_err() || !reports.unwrap().is_empty());
});
