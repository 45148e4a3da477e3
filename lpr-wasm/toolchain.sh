# Sourced by the scripts that build for wasm, from the root of the workspace or of a copy of it.
# Sets `wasm_target`, `wasm_toolchain` (the name of the first toolchain that can: `rustup` with its target, else `debian`, whose
# rustc-web builds the standard library from source) and `wasm_cargo` (its cargo, with what it needs).

# The flags that a module needs are in .cargo/config.toml; this variable would replace them.
unset RUSTFLAGS

wasm_target=wasm32-unknown-unknown

has_rustup_target() {
    local libdir
    libdir=$(rustc --print target-libdir --target "$wasm_target" 2>/dev/null) && compgen -G "$libdir/libstd-*.rlib" >/dev/null
}

has_debian_sources() {
    [[ -x /usr/bin/rustc && -x /usr/bin/cargo && -x /usr/bin/wasm-ld-22 ]] &&
        [[ -d $(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library ]]
}

if has_rustup_target; then
    wasm_toolchain=rustup
    wasm_cargo=(cargo)
    echo "lpr-wasm: $(rustc --version) with its own $wasm_target"
elif has_debian_sources; then
    wasm_toolchain=debian
    wasm_cargo=(
        env "PATH=/usr/bin:$PATH" RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1
        CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER=/usr/bin/wasm-ld-22
        /usr/bin/cargo -Zbuild-std=std,panic_abort
    )
    echo "lpr-wasm: $(/usr/bin/rustc --version) of Debian's rustc-web, standard library from source"
else
    echo "error: nothing here builds for $wasm_target. Either: rustup target add $wasm_target" >&2
    echo "       or, on Debian: apt-get install rustc-web cargo-web rust-web-src lld-22" >&2
    exit 1
fi

# Prints the path of wasm-bindgen below `$1`, in exactly the version of the crate, which it has to have; installs it if it must.
# Without --locked: its own lock file asks for a library version that not every mirror of the registry has.
wasm_bindgen() {
    local version tools=$1/tools
    version=$(sed -n 's/^wasm-bindgen = "=\(.*\)"$/\1/p' Cargo.toml)
    if [[ "$("$tools/bin/wasm-bindgen" --version 2>/dev/null)" != "wasm-bindgen $version" ]]; then
        echo "lpr-wasm: installing wasm-bindgen-cli $version" >&2
        cargo install wasm-bindgen-cli --version "$version" --no-default-features --root "$tools" --target-dir "$tools/build" >&2
    fi
    echo "$tools/bin/wasm-bindgen"
}
