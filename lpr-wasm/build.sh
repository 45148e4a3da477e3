#!/usr/bin/env bash
# Builds lpr-wasm for wasm32-unknown-unknown with the first toolchain that can: rustup's target, else Debian's rustc-web, which
# builds the standard library from source. Usage: lpr-wasm/build.sh [directory for build products, default target-wasm].
set -euo pipefail
cd "$(dirname "$0")/.."

target=wasm32-unknown-unknown
target_dir=${1:-${LPR_WASM_TARGET_DIR:-target-wasm}}
arguments=(build --locked --profile wasm --target "$target" -p lpr-wasm)
# The flags that the module needs are in .cargo/config.toml; this variable would replace them.
unset RUSTFLAGS

has_rustup_target() {
    local libdir
    libdir=$(rustc --print target-libdir --target "$target" 2>/dev/null) && compgen -G "$libdir/libstd-*.rlib" >/dev/null
}

has_debian_sources() {
    [[ -x /usr/bin/rustc && -x /usr/bin/cargo && -x /usr/bin/wasm-ld-22 ]] &&
        [[ -d $(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library ]]
}

if has_rustup_target; then
    echo "lpr-wasm: $(rustc --version) with its own $target"
    cargo "${arguments[@]}" --target-dir "$target_dir/rustup"
    built=$target_dir/rustup
elif has_debian_sources; then
    echo "lpr-wasm: $(/usr/bin/rustc --version) of Debian's rustc-web, standard library from source"
    PATH=/usr/bin:$PATH RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1 CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER=/usr/bin/wasm-ld-22 \
        /usr/bin/cargo "${arguments[@]}" -Zbuild-std=std,panic_abort --target-dir "$target_dir/debian"
    built=$target_dir/debian
else
    echo "error: nothing here builds for $target. Either: rustup target add $target" >&2
    echo "       or, on Debian: apt-get install rustc-web cargo-web rust-web-src lld-22" >&2
    exit 1
fi

module=$target_dir/lpr_wasm.wasm
cp "$built/$target/wasm/lpr_wasm.wasm" "$module"
echo "lpr-wasm: $module, $(stat -c %s "$module") bytes"
