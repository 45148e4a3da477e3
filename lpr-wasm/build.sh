#!/usr/bin/env bash
# Builds lpr-wasm: the module, then its JavaScript with wasm-bindgen. For the page into www/src/wasm; the planner alone, without
# networks and simulator, into lpr-wasm/pkg; the same with arms from URDF files into lpr-wasm/pkg-files.
# Usage: lpr-wasm/build.sh [page|plan|files] [directory for build products, default target-wasm].
set -euo pipefail
cd "$(dirname "$0")/.."
source lpr-wasm/toolchain.sh

out=www/src/wasm
selection=(--no-default-features --features page)
case ${1:-} in
    page) shift ;;
    plan)
        shift
        out=lpr-wasm/pkg
        selection=(--no-default-features --features planners)
        ;;
    files)
        shift
        out=lpr-wasm/pkg-files
        selection=(--no-default-features --features planners,files)
        ;;
esac
target_dir=${1:-${LPR_WASM_TARGET_DIR:-target-wasm}}
built=$target_dir/$wasm_toolchain

"${wasm_cargo[@]}" build --locked --profile wasm --target "$wasm_target" -p lpr-wasm "${selection[@]}" --target-dir "$built"
generator=$(wasm_bindgen "$target_dir")
"$generator" --target web --remove-name-section --remove-producers-section --out-dir "$out" "$built/$wasm_target/wasm/lpr_wasm.wasm"
module=$out/lpr_wasm_bg.wasm
echo "lpr-wasm: $module, $(stat -c %s "$module") bytes, $(gzip -9c "$module" | wc -c) with gzip"
