#!/usr/bin/env bash
# Runs every command of README, book and the crates' READMEs, in order, in a scratch copy of the project. Training trains, so that
# this takes hours. Servers run in the background until their document ends; the server's port 8080 and the emulator's ports
# have to be free.
# Usage: tests/docs_long.sh [--list] [DOCUMENT...]; --list prints the commands and runs nothing.
set -euo pipefail
cd "$(dirname "$0")/.."
workspace=$PWD

list=
[[ ${1:-} != --list ]] || { list=yes; shift; }
documents=("$@")
if ((${#documents[@]} == 0)); then
    mapfile -t chapters < <(sed -n 's|.*](\(.*\.md\))$|docs/\1|p' docs/SUMMARY.md)
    documents=(README.md "${chapters[@]}" lpr-*/README.md lpr-server/xarm/README.md)
fi

commands_of() { awk '/^```/ { inside = ($0 == "```sh"); next } inside' "$1"; }

if [[ -n $list ]]; then
    for document in "${documents[@]}"; do commands_of "$document"; done
    exit
fi

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
checkout=$scratch/checkout
mkdir "$checkout"
git ls-files -z | xargs -0 cp --parents -t "$checkout"
# Tests ask git which files are the project's.
git -C "$checkout" init --quiet
for built in target target-wasm; do
    mkdir -p "$built"
    ln -s "$workspace/$built" "$checkout/$built"
done

# What a reader does without being told: waits until a server listens, and fills in the id of the newest job.
cat >"$scratch/prelude.sh" <<'EOF'
set -euo pipefail
set -m
wait_for() {
    for _ in $(seq 1800); do
        if (: <"/dev/tcp/127.0.0.1/$1") 2>/dev/null; then return; fi
        sleep 1
    done
    echo "nothing listens on port $1" >&2
    return 1
}
newest_job() { command curl -s 127.0.0.1:8080/v1/jobs | grep -o '"id":"[^"]*"' | head -n 1 | cut -d '"' -f 4; }
curl() {
    # A stream of events ends with its job: a minute of it is enough.
    timeout 60 curl --fail-with-body "$@" || (($? == 124))
    echo
}
end_servers() {
    for job in $(jobs -p); do kill -- "-$job" 2>/dev/null || true; done
    wait
}
trap end_servers EXIT
set -v
EOF

# A training run or a check that an earlier document has made is not made again: its directory is there.
runnable() {
    awk -v seen_file="$scratch/seen" '
        BEGIN { while ((getline line < seen_file) > 0) seen[line] = 1 }
        { key = $0; sub(/ *#.*/, "", key) }
        / -- train |^make / { if (key in seen) next; seen[key] = 1; print key >> seen_file }
        / -- serve/ || / -- xarm emulate/ {
            sub(/ *&$/, "", key)
            print key " &"
            print "wait_for " (key ~ /serve/ ? 8080 : 5020)
            next
        }
        { gsub(/\/jobs\/ID/, "/jobs/$(newest_job)"); print }'
}

touch "$scratch/seen"
for document in "${documents[@]}"; do
    echo "== $document"
    { cat "$scratch/prelude.sh"; commands_of "$document" | runnable; } >"$scratch/commands.sh"
    (cd "$checkout" && bash "$scratch/commands.sh") || { echo "error: a command of $document failed" >&2; exit 1; }
done
