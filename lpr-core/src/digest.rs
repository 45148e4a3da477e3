//! FNV-1a, 64 bits: one digest for files, worlds and comparisons of two machines.
//!
//! It tells damage, not malice. A single changed byte always changes it.
//!
//! ```
//! use lpr_core::digest;
//!
//! assert_eq!(digest::extend(digest::of(b"foo"), b"bar"), digest::of(b"foobar"));
//! ```

const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

/// Digest of some bytes.
#[must_use]
pub fn of(bytes: &[u8]) -> u64 {
    extend(OFFSET, bytes)
}

/// Digest of bytes that follow those of `digest`.
#[must_use]
pub fn extend(digest: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(digest, |digest, &byte| (digest ^ u64::from(byte)).wrapping_mul(PRIME))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_that_of_the_published_vectors() {
        // http://www.isthe.com/chongo/tech/comp/fnv/
        assert_eq!(of(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(of(b"a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(of(b"foobar"), 0x8594_4171_f739_67e8);
        assert_eq!(extend(of(b"foo"), b"bar"), of(b"foobar"));
    }
}
