//! End-to-end suites over the public surface of the crates.

mod architecture;
