#!/usr/bin/env bash
# Packs lpr-core, unpacks it far from the workspace, and builds a fresh crate on it without its default features: the program of
# its README. Prints how many packages that takes and how long it builds; fails when they are more than MOST_PACKAGES.
# Usage: tests/package.sh [arguments for cargo, such as --release]
set -euo pipefail
cd "$(dirname "$0")/.."

MOST_PACKAGES=60

say() { echo "package: $*"; }

directory=$(mktemp -d)
trap 'rm -rf "$directory"' EXIT
# Where a file of the workspace is meant, nothing may be found: neither sources, nor settings, nor products.
unset CARGO_TARGET_DIR RUSTFLAGS

cargo package -p lpr-core --locked --no-verify --allow-dirty --quiet --target-dir "$directory/packed"
archive=$(echo "$directory"/packed/package/lpr-core-*.crate)
tar -xzf "$archive" -C "$directory"
say "$(basename "$archive"), $(stat -c %s "$archive") bytes"

user=$directory/user
mkdir -p "$user/src"
# The versions of the workspace, so that nothing is downloaded that the workspace did not need.
cp Cargo.lock "$user"
cat >"$user/Cargo.toml" <<END
[package]
name = "user"
version = "0.1.0"
edition = "2024"

[dependencies]
lpr-core = { path = "$(basename "$archive" .crate | sed 's|^|../|')", default-features = false }
END
{
    echo 'fn main() {'
    awk '/^```/ { inside = $0 == "```rust"; next } inside' lpr-core/README.md
    echo 'println!("{} configurations, a path of {} and {:.2} rad", goals.len(), path.configs().len(), path.length());'
    echo '}'
} >"$user/src/main.rs"

cd "$user"
n_packages=$(cargo tree --edges normal,build --prefix none --no-dedupe | grep -v "^user " | sort -u | wc -l)
say "$n_packages packages for planning alone"
if ((n_packages > MOST_PACKAGES)); then
    cargo tree --edges normal,build
    say "error: at most $MOST_PACKAGES expected"
    exit 1
fi
started=$EPOCHREALTIME
cargo build --quiet "$@"
say "$(awk "BEGIN { printf \"%.1f\", $EPOCHREALTIME - $started }") s to build from nothing ${*:-in the dev profile}, $(cut -d' ' -f1 /proc/loadavg) jobs"
say "$(cargo run --quiet "$@")"
