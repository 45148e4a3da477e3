#!/usr/bin/env bash
# Packs the crates as `cargo package` does and uses the archives as somebody else would, outside of this workspace:
# - all four build, lpr-core with its examples, beside a fresh crate (tests/package/user) that runs the program of lpr-core's README
#   and learns in a world of its own, natively and in Node, with the same answers;
# - without its default features lpr-core builds from nothing, of at most MOST_PACKAGES packages.
# What the workspace depends on is taken from its own products, where it is built with the same features and profiles.
set -euo pipefail
cd "$(dirname "$0")/.."
source lpr-wasm/toolchain.sh

MOST_PACKAGES=60
MOST_LINES=15
LEAST_SUCCESS=0.95
MOST_SECONDS=60

say() { echo "package: $*"; }

fail() {
    say "error: $*"
    exit 1
}

# Holds for the arithmetic of `$1`.
holds() { awk "BEGIN { exit !($1) }"; }

since() { awk "BEGIN { printf \"%.1f\", $EPOCHREALTIME - $1 }"; }

directory=$(mktemp -d)
trap 'rm -rf "$directory"' EXIT
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
wasm_products=$(realpath -m "${LPR_WASM_TARGET_DIR:-target-wasm}")
workspace=$directory/workspace
# Where a file of the workspace is meant, nothing may be found: neither sources, nor settings, nor products.
unset CARGO_TARGET_DIR

# The archives in $workspace/packed. Their files bear one date for all times, by which cargo would take all versions for the same:
# hence --touch.
pack() {
    local crate archive
    cargo package --workspace --exclude lpr-tests --locked --no-verify --allow-dirty --quiet --target-dir "$directory/packages"
    for crate in lpr-core lpr-wasm lpr-server lpr-xarm; do
        archive=$(echo "$directory/packages/package/$crate"-*.crate)
        say "$(basename "$archive"), $(stat -c %s "$archive") bytes"
        mkdir -p "$workspace/packed/$crate"
        tar -xzf "$archive" --touch --strip-components=1 -C "$workspace/packed/$crate"
    done
    # The module of lpr-wasm bears no hash in its name: it would take the place of the one that `make page` has built.
    sed -i '/^crate-type = \[/,/^\]/c crate-type = ["rlib"]' "$workspace/packed/lpr-wasm/Cargo.toml"
}

# The program of lpr-core's README as a function that says what it found.
readme_program() {
    local program
    program=$(awk '/^```/ { inside = $0 == "```rust"; next } inside' "$workspace/packed/lpr-core/README.md")
    (($(grep -c . <<<"$program") <= MOST_LINES)) || fail "the README's program has over $MOST_LINES lines"
    echo 'pub fn plan() -> String {'
    echo "$program"
    echo '    format!("{} configurations, a path of {} and {} rad", goals.len(), path.configs().len(), path.length())'
    echo '}'
}

# A workspace of the archives, the fresh crate and the tests. The latter are not built: without what they ask of dependencies,
# these would be others than those that `make test` has built.
prepare_workspace() {
    sed -e '/^default-members/d' -e 's|^members = .*|members = ["packed/*", "tests", "user"]|' -e 's|path = "lpr-server/xarm"|path = "lpr-xarm"|' \
        -e 's|path = "lpr-|path = "packed/lpr-|' \
        Cargo.toml >"$workspace/Cargo.toml"
    printf '\n[patch.crates-io]\nlpr-core = { path = "packed/lpr-core" }\nlpr-xarm = { path = "packed/lpr-xarm" }\n' >>"$workspace/Cargo.toml"
    cp -r Cargo.lock .cargo tests/package/user "$workspace"
    mkdir "$workspace/tests"
    cp -r tests/Cargo.toml tests/src tests/suite "$workspace/tests"
    cp "$workspace/packed/lpr-core/examples/own_environment.rs" "$workspace/user/src"
    readme_program >"$workspace/user/src/readme.rs"
}

build_natively() {
    local started=$EPOCHREALTIME
    CARGO_BUILD_BUILD_DIR=$target CARGO_INCREMENTAL=0 cargo build --quiet --workspace --features lpr-core/ndarray \
        --lib --bins --examples --target-dir "$directory/native"
    say "$("$directory/native/debug/lpr" --version) and all crates built from the archives in $(since "$started") s"
}

# Along with lpr-wasm, for whose features the dependencies are built.
build_for_wasm() {
    local started=$EPOCHREALTIME
    CARGO_BUILD_BUILD_DIR=$wasm_products/$wasm_toolchain "${wasm_cargo[@]}" build --quiet --profile wasm --target "$wasm_target" \
        -p lpr-wasm -p user --lib --target-dir "$directory/wasm"
    "$(wasm_bindgen "$wasm_products")" --target nodejs --out-dir "$directory/node" "$directory/wasm/$wasm_target/wasm/user.wasm"
    say "for wasm in $(since "$started") s"
}

# Runs the fresh crate as the rest of the arguments say, and looks at its two lines: what it planned, which it leaves in `planned`,
# and its success before and after learning.
use_it() {
    local where=$1 started=$EPOCHREALTIME output seconds before after
    output=$("${@:2}")
    seconds=$(since "$started")
    { read -r planned && read -r before after; } <<<"$output"
    say "$where: $planned; success $before before and $after after learning, $seconds s"
    holds "$after >= $LEAST_SUCCESS" || fail "at least $LEAST_SUCCESS expected"
    holds "$seconds <= $MOST_SECONDS" || fail "at most $MOST_SECONDS s expected"
}

# The README's program by itself, with the versions of the workspace, so that nothing is downloaded that it did not need.
build_planning_alone() {
    local user=$directory/planning n_packages started
    mkdir -p "$user/src"
    cp Cargo.lock "$user"
    cat >"$user/Cargo.toml" <<END
[package]
name = "planning"
version = "0.1.0"
edition = "2024"

[dependencies]
lpr-core = { path = "$workspace/packed/lpr-core", default-features = false }
END
    {
        cat "$workspace/user/src/readme.rs"
        echo 'fn main() { println!("{}", plan()); }'
    } >"$user/src/main.rs"
    cd "$user"
    n_packages=$(cargo tree --edges normal,build --prefix none --no-dedupe | grep -v "^planning " | sort -u | wc -l)
    say "$n_packages packages for planning alone"
    ((n_packages <= MOST_PACKAGES)) || fail "at most $MOST_PACKAGES expected"
    started=$EPOCHREALTIME
    cargo build --quiet
    say "$(since "$started") s to build it from nothing in the dev profile, $(cut -d' ' -f1 /proc/loadavg) jobs"
    say "$(cargo run --quiet)"
}

pack
prepare_workspace
(build_planning_alone)
cd "$workspace"
build_natively
use_it natively "$directory/native/debug/user"
natively=$planned
build_for_wasm
use_it "in Node" node user/run.cjs "$directory/node/user.js"
[[ $planned == "$natively" ]] || fail "natively it planned otherwise: $natively"
