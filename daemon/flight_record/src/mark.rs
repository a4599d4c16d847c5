//! The bytes before each session. They hold the version of the layout.

use std::fmt;
use std::io;

/// Version of the layout. Since 7 estimates name the sensors that contributed.
pub const VERSION: u8 = 7;
/// Read as a length, the first four bytes exceed that of any frame. The digit is [`VERSION`].
pub const MARK: &[u8; 16] = b"\xff\xff\xff\xffflight-rec7\n";
/// Where the version's digit stands.
const DIGIT: usize = 14;

/// The file is a record of another version of the layout. An `io::Error` of this crate may hold it
/// ([`OtherVersion::in_error`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OtherVersion {
    /// Its version's digit.
    pub found: char,
}

impl OtherVersion {
    /// What the error holds, if that is the reason.
    pub fn in_error(error: &io::Error) -> Option<Self> {
        error.get_ref()?.downcast_ref().copied()
    }
}

impl fmt::Display for OtherVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "it is a flight record of version {}; needed: version {VERSION}, or the program that wrote it",
            self.found
        )
    }
}

impl std::error::Error for OtherVersion {}

/// # Errors
/// [`OtherVersion`], where these bytes are the mark of such a record.
pub(crate) fn check_version(bytes: &[u8]) -> io::Result<()> {
    let is_record = bytes.len() == MARK.len() && bytes[..DIGIT] == MARK[..DIGIT] && bytes[15] == MARK[15];
    let version =
        bytes.get(DIGIT).filter(|digit| is_record && digit.is_ascii_digit() && **digit != MARK[DIGIT]);
    version.map_or(Ok(()), |digit| Err(io::Error::other(OtherVersion { found: char::from(*digit) })))
}
