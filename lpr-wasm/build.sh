#!/usr/bin/env bash
# Builds lpr-wasm: the module with the first toolchain that can (rustup's target, else Debian's rustc-web, which builds the
# standard library from source), then its JavaScript with wasm-bindgen. For the page into www/src/wasm; the planner alone, without
# networks and simulator, into lpr-wasm/pkg.
# Usage: lpr-wasm/build.sh [page|plan] [directory for build products, default target-wasm].
set -euo pipefail
cd "$(dirname "$0")/.."

target=wasm32-unknown-unknown
out=www/src/wasm
selection=()
case ${1:-} in
    page) shift ;;
    plan)
        shift
        out=lpr-wasm/pkg
        selection=(--no-default-features)
        ;;
esac
target_dir=${1:-${LPR_WASM_TARGET_DIR:-target-wasm}}
arguments=(build --locked --profile wasm --target "$target" -p lpr-wasm "${selection[@]}")
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

# Prints the path of wasm-bindgen in exactly the version of the crate, which it has to have; installs it if it must.
# Without --locked: its own lock file asks for a library version that not every mirror of the registry has.
wasm_bindgen() {
    local version tools=$target_dir/tools
    version=$(sed -n 's/^wasm-bindgen = "=\(.*\)"$/\1/p' Cargo.toml)
    if [[ "$("$tools/bin/wasm-bindgen" --version 2>/dev/null)" != "wasm-bindgen $version" ]]; then
        echo "lpr-wasm: installing wasm-bindgen-cli $version" >&2
        cargo install wasm-bindgen-cli --version "$version" --no-default-features --root "$tools" --target-dir "$tools/build" >&2
    fi
    echo "$tools/bin/wasm-bindgen"
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

generator=$(wasm_bindgen)
"$generator" --target web --remove-name-section --remove-producers-section --out-dir "$out" "$built/$target/wasm/lpr_wasm.wasm"
module=$out/lpr_wasm_bg.wasm
echo "lpr-wasm: $module, $(stat -c %s "$module") bytes, $(gzip -9c "$module" | wc -c) with gzip"
