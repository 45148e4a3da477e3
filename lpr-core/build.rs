//! A digest of everything in this crate that decides a result, so that results can say of which
//! program they are: `lpr_core::SOURCE_DIGEST`.

#![expect(
    clippy::disallowed_methods,
    reason = "the library has no files and no environment, its build does"
)]

use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it"));
    let mut files = Vec::new();
    for place in ["src", "presets"] {
        println!("cargo::rerun-if-changed={place}");
        collect(&root.join(place), &mut files);
    }
    // Versions of the dependencies, where they are locked: in a checkout.
    let lock = root.join("../Cargo.lock");
    if lock.exists() {
        println!("cargo::rerun-if-changed={}", lock.display());
        files.push(lock);
    }
    files.sort();
    // FNV-1a, as `src/digest.rs`, which a build script cannot use.
    let extend = |sum: u64, bytes: &[u8]| {
        bytes.iter().fold(sum, |sum, &byte| (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
    };
    let of_file = |sum, file: &PathBuf| {
        let name = file.strip_prefix(&root).unwrap_or(file).to_string_lossy().replace('\\', "/");
        let content = fs::read(file).expect("a file of this crate");
        extend(extend(sum, name.as_bytes()), &content)
    };
    let sum = files.iter().fold(0xcbf2_9ce4_8422_2325, of_file);
    println!("cargo::rustc-env=LPR_SOURCE_DIGEST={sum:016x}");
}

fn collect(directory: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(directory).expect("a directory of this crate") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            collect(&path, files);
        } else {
            files.push(path);
        }
    }
}
