# `make check` is exactly what CI runs.
.PHONY: check fmt lint doc test test-doc test-ndarray wasm

check: fmt lint doc test test-doc test-ndarray wasm

fmt:
	cargo fmt --all --check

lint:
	cargo clippy --locked --workspace --all-targets -- -D warnings

doc:
	RUSTDOCFLAGS=-Dwarnings cargo doc --locked --workspace --no-deps

test:
	cargo nextest run --locked --workspace

test-doc:
	cargo test --locked --doc --workspace

# burn-ndarray as a reference for burn-flex, in the same profile and features, so that little is built again.
test-ndarray:
	cargo nextest run --locked --workspace --features lpr-core/ndarray -E 'test(ndarray)' --no-tests=warn

wasm:
	lpr-wasm/build.sh
