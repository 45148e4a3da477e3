# `make check` is exactly what CI runs. It has one feature set, with burn-ndarray as a reference for
# burn-flex in tests: a second set would build all of burn once more. lpr-wasm/build.sh builds
# without it.
ALL := --locked --workspace --features lpr-core/ndarray

.PHONY: check setup fmt lint deny doc book docs-long page planner gallery test test-doc package tools faults robots fuzz bench-wasm bench-pytorch

check: setup fmt lint deny doc book page planner test test-doc package

# The tools that the other targets need. Everything else waits for it, also with -j.
setup:
	.ci/setup

fmt lint deny doc book page planner test test-doc package: | $(if $(filter check,$(MAKECMDGOALS)),setup)

fmt:
	cargo fmt --all --check

lint:
	cargo clippy $(ALL) --all-targets -- -D warnings

# Licenses, sources and versions of dependencies: deny.toml.
deny:
	cargo deny --locked --workspace check licenses bans sources

doc:
	RUSTDOCFLAGS=-Dwarnings cargo doc $(ALL) --no-deps

# The book, in target/book.
book:
	mdbook build docs

# Every command of README and book, in order; hours.
docs-long:
	tests/docs_long.sh

# With the page's tests, which visit what `make page` has built.
test: tools
	cargo build $(ALL) --bin lpr
	cargo nextest run $(ALL)

# Kills runs 20 times with the demonstrator's poses and 20 times with learned ones; `test` does so 4 times.
faults:
	LPR_KILLS=20 cargo nextest run $(ALL) -E 'test(interrupted::)' --profile faults --no-capture

# What tests run beside the binary: Python with the vendor's SDK of the xArm.
tools:
	tests/python.sh

# Arms as their makers describe them: kinematics beside Pinocchio, plans checked on meshes by coal; an hour.
robots:
	tests/python.sh peers
	cargo build --release --locked
	tests/peers/.venv/bin/python tests/peers/robot_files.py target/release/lpr
	tests/peers/.venv/bin/python tests/peers/arms_on_meshes.py target/release/lpr

# 100,000 broken descriptions of arms: no panic, none takes a second, each message says where.
fuzz:
	LPR_FUZZ_CASES=20000 cargo test --locked -p lpr-core --no-default-features --features planners,hulls,parallel --lib -- robot::urdf::fuzz

test-doc:
	cargo test $(ALL) --doc

# The crates as others get them: packed, unpacked and used, natively and in Node. After `test` and `page` it needs little more than
# the crates themselves.
package:
	tests/package.sh

# Physics in wasm beside native code, measured in turn.
bench-wasm:
	lpr-wasm/build.sh
	cargo build --release --locked
	node tests/node/bench.mjs target/release/lpr

# Networks beside PyTorch, measured in turn; slow, by hand on a quiet machine: PyTorch's wheel alone is gigabytes.
bench-pytorch:
	tests/python.sh peers/pytorch
	cargo build --release --locked
	tests/peers/pytorch/.venv/bin/python tests/peers/pytorch/beside.py target/release/lpr

# The demo page, in www/dist: `lpr serve` serves it from there.
page: www/node_modules
	lpr-wasm/build.sh
	cd www && npm run build

# Planning alone in wasm, in lpr-wasm/pkg; with arms from files, in lpr-wasm/pkg-files.
planner:
	lpr-wasm/build.sh plan
	lpr-wasm/build.sh files

www/node_modules: www/package-lock.json
	cd www && npm ci --ignore-scripts --no-audit --no-fund
	touch $@

# A picture and an animation of every task, and the page that shows them: docs/gallery.md. The same scenes give the same bytes.
gallery:
	rm -rf docs/gallery
	cargo run --release --locked -- gallery --out docs/gallery
