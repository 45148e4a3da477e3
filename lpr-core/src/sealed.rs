//! Sealed bytes: a file of this program begins with magic, version and digest of what follows.
//!
//! The digest tells damage, not malice.

use crate::digest;

/// Length of magic, version and digest.
const HEADER: usize = 20;

/// The head of one kind of file.
#[derive(Debug)]
pub(crate) struct Seal {
    /// The first bytes.
    pub(crate) magic: [u8; 8],
    /// Version of the layout that is written, and the newest that is read.
    pub(crate) version: u32,
    /// The oldest version that is read.
    pub(crate) oldest: u32,
}

/// Reason why bytes are not opened.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum SealError {
    /// There is no room for a head.
    #[error("length: expected at least {HEADER} bytes, found {found}")]
    Short {
        /// Length of the bytes.
        found: usize,
    },
    /// The file is of another kind.
    #[error(
        "first bytes: expected `{}`, found `{}`",
        .expected.escape_ascii(),
        .found.escape_ascii()
    )]
    Magic {
        /// The magic of this kind of file.
        expected: [u8; 8],
        /// The file's first bytes.
        found: [u8; 8],
    },
    /// The layout is newer, or older than what is still read.
    #[error("version: expected {}, found {found}", versions(*oldest, *newest))]
    Version {
        /// The oldest that is read.
        oldest: u32,
        /// The newest that is read.
        newest: u32,
        /// That of the file.
        found: u32,
    },
    /// Bytes were changed or are missing.
    #[error("damaged or cut short: the digest does not fit the content")]
    Digest,
}

impl Seal {
    /// Magic, version, digest of `payload`, then `payload`; numbers are little endian.
    pub(crate) fn seal(&self, payload: &[u8]) -> Vec<u8> {
        let (version, digest) = (self.version.to_le_bytes(), digest::of(payload).to_le_bytes());
        [&self.magic[..], &version, &digest, payload].concat()
    }

    /// The payload of sealed bytes.
    pub(crate) fn open<'a>(&self, bytes: &'a [u8]) -> Result<&'a [u8], SealError> {
        let short = || SealError::Short { found: bytes.len() };
        let (magic, rest) = bytes.split_first_chunk().ok_or_else(short)?;
        if *magic != self.magic {
            return Err(SealError::Magic { expected: self.magic, found: *magic });
        }
        let (version, rest) = rest.split_first_chunk().ok_or_else(short)?;
        let (digest, payload) = rest.split_first_chunk().ok_or_else(short)?;
        // Before the digest: a newer program may well compute another.
        let found = u32::from_le_bytes(*version);
        if !(self.oldest..=self.version).contains(&found) {
            return Err(SealError::Version { oldest: self.oldest, newest: self.version, found });
        }
        if u64::from_le_bytes(*digest) != digest::of(payload) {
            return Err(SealError::Digest);
        }
        Ok(payload)
    }
}

fn versions(oldest: u32, newest: u32) -> String {
    if oldest == newest { newest.to_string() } else { format!("{oldest} to {newest}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEAL: Seal = Seal { magic: *b"LPRSTATE", version: 3, oldest: 2 };

    #[test]
    fn the_layout_of_the_head_is_this() {
        // FNV-1a of `foobar` is 0x85944171f73967e8.
        let sealed = b"LPRSTATE\x03\x00\x00\x00\xe8\x67\x39\xf7\x71\x41\x94\x85foobar";
        assert_eq!(SEAL.seal(b"foobar"), sealed);
        assert_eq!(SEAL.open(sealed), Ok(&b"foobar"[..]));
        assert_eq!(SEAL.open(&SEAL.seal(b"")), Ok(&b""[..]));
    }

    #[test]
    fn bytes_that_are_not_sealed_like_this_are_refused() {
        let sealed = SEAL.seal(b"foobar");
        assert_eq!(SEAL.open(&sealed[..19]), Err(SealError::Short { found: 19 }));
        assert_eq!(SEAL.open(&sealed[..25]), Err(SealError::Digest));
        let error = |bytes: &[u8]| SEAL.open(bytes).expect_err("refused").to_string();
        let mut other = sealed.clone();
        other[3..8].copy_from_slice(b"WORLD");
        assert_eq!(error(&other), "first bytes: expected `LPRSTATE`, found `LPRWORLD`");
        other.clone_from(&sealed);
        other[24] ^= 1;
        assert_eq!(error(&other), "damaged or cut short: the digest does not fit the content");
    }

    #[test]
    fn versions_in_between_are_read() {
        let of_version = |version| Seal { version, ..SEAL }.seal(b"foobar");
        assert_eq!(SEAL.open(&of_version(2)), Ok(&b"foobar"[..]));
        for found in [1, 4] {
            let error = SEAL.open(&of_version(found)).expect_err("another version").to_string();
            assert_eq!(error, format!("version: expected 2 to 3, found {found}"));
        }
        let only = Seal { oldest: 3, ..SEAL };
        let error = only.open(&of_version(2)).expect_err("an old version").to_string();
        assert_eq!(error, "version: expected 3, found 2");
    }
}
