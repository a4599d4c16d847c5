//! Commands of an operator, and the service's answers.

use crate::payload::status::Status;
use iceoryx2::prelude::ZeroCopySend;

constants! {
    /// Values of [`Command::kind`].
    pub mod command: u32 {
        /// Forget state and weights; start again from the next sample.
        RESET = 1;
        /// Stop learning; keep using what was learned.
        FREEZE = 2;
        /// Learn again.
        THAW = 3;
        /// Write the learned weights to disk.
        SAVE = 4;
        /// Only answer with the status.
        STATUS = 5;
    }
}

constants! {
    /// Values of [`Reply::outcome`].
    pub mod outcome: u32 {
        /// Done: the loop has carried the command out.
        DONE = 0;
        /// Refused: `message` says why.
        REFUSED = 1;
        /// The command's kind is unknown to this service.
        UNKNOWN = 2;
    }
}

payload! {
    /// An operator's request.
    #[derive(Default, Eq)]
    pub struct Command: "observer.Command.v1" {
        /// One of [`command`].
        kind: u32,
        /// Zero.
        reserved: u32,
    }
}

payload! {
    /// The service's answer, with its status after the command.
    pub struct Reply: "observer.Reply.v4" {
        /// One of [`outcome`].
        outcome: u32,
        /// Bytes of `message` in use.
        message_bytes: u32,
        /// UTF-8 text.
        message: [u8; 248],
        /// Status after the command.
        status: Status,
    }
}

impl Default for Reply {
    fn default() -> Self {
        Self::new(outcome::DONE, "", Status::default())
    }
}

impl Reply {
    /// A reply whose text is cut at a character's boundary if it does not fit.
    pub fn new(outcome: u32, text: &str, status: Status) -> Self {
        let mut message = [0; 248];
        let end = text.floor_char_boundary(message.len());
        message[..end].copy_from_slice(&text.as_bytes()[..end]);
        Self { outcome, message_bytes: end as u32, message, status }
    }

    /// The text, or nothing where the bytes are no text.
    pub fn text(&self) -> &str {
        let end = (self.message_bytes as usize).min(self.message.len());
        str::from_utf8(&self.message[..end]).unwrap_or("")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reply_cuts_its_text_at_a_character() {
        let long = "ä".repeat(200);
        let reply = Reply::new(outcome::REFUSED, &long, Status::default());
        assert_eq!(reply.text(), "ä".repeat(124));
        assert_eq!(Reply { message_bytes: u32::MAX, ..reply }.text(), "ä".repeat(124));
    }
}
