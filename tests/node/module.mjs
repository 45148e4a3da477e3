// The module that lpr-wasm/build.sh has made for the page, in Node.

import { readFileSync } from "node:fs";
import * as wasm from "../../www/src/wasm/lpr_wasm.js";

wasm.initSync({ module: readFileSync(new URL("../../www/src/wasm/lpr_wasm_bg.wasm", import.meta.url)) });

export default wasm;
