#!/bin/sh
# Checks baked models with the Khronos glTF validator and, in a browser without a window, with three.js.
# Needs node 20.11 or later with npm, and chromium; CHROMIUM names another program of this kind. Everything is written to target/web.
set -eu
cd "$(dirname "$0")/.."

need() {
    echo "make test-web needs $1; on Debian: sudo apt-get install $2" >&2
    exit 1
}
command -v node >/dev/null || need "node 20.11 or later" nodejs
command -v npm >/dev/null || need npm npm
node -e 'const [a, b] = process.versions.node.split("."); process.exit(a > 20 || (a == 20 && b >= 11) ? 0 : 1)' ||
    need "node 20.11 or later (found $(node --version))" nodejs
if [ -z "${CHROMIUM:-}" ]; then
    for name in chromium chromium-browser google-chrome; do
        CHROMIUM=$(command -v "$name") && break
    done
fi
[ -n "${CHROMIUM:-}" ] || need "chromium, or CHROMIUM with the path of such a program" chromium
command -v "$CHROMIUM" >/dev/null || need "chromium ($CHROMIUM does not exist)" chromium

folder=target/web
mkdir -p "$folder"
cp tests/web/package.json tests/web/package-lock.json "$folder"
npm ci --prefix "$folder" --no-audit --no-fund --silent
lightsum="cargo run --release --quiet --"
bake="--density 0.2 --passes 16"
$lightsum bake scenes/cornell/scene.toml -o "$folder/lit.glb" $bake
$lightsum bake scenes/cornell/scene.toml -o "$folder/room.glb" $bake --unlit --exposure 0
$lightsum render scenes/cornell/scene.toml --light-from "$folder/room.glb" -o "$folder/own.png" --resolution 640x480 --passes 16 --exposure 0
node tests/web/check.mjs "$folder" "$CHROMIUM"
