# make help               list these commands
# make demo               render the Cornell box into out/; installs a Vulkan driver first if there is none
# make test               all tests: on lavapipe with the validation layer, a part of them again on SwiftShader; half an hour to an hour
# make test-swiftshader   the tests on the device again, on another driver
# make test-web           baked models in the glTF validator and, in a browser, with three.js; needs node, npm and chromium
# make test-wgpu          lightsum on the device of wgpu (examples/wgpu, a crate of its own), which make test does too
# make bench              seconds of each pass, for the Cornell box and a generated room
# make lint               formatting, clippy, documentation, and the public interface against the list that is kept
# make build              the programs alone
# cargo bench             host stages and GPU passes by criterion; --bench host needs no device

# Passes of the demo: more are smoother and take longer in proportion.
DEMO_PASSES ?= 16

# The feature needs the library once more; its few tests are not worth optimising it.
HOT_RELOAD = --features hot-reload --test hot_reload --config profile.dev.opt-level=0

# Several ranks, by the system's MPI; likewise.
MPI = --features mpi --test cli --config profile.dev.opt-level=0

.PHONY: help build demo test test-swiftshader test-web test-wgpu bench lint

build:
	cargo build --release

help:
	@sed -nE 's/^# ((make|cargo) .*)/\1/p' $(firstword $(MAKEFILE_LIST))

demo:
	scripts/setup.sh
	cargo build --release
	mkdir -p out
	cargo run --release --quiet -- render scenes/cornell/scene.toml --resolution 640x480 \
		--passes $(DEMO_PASSES) --output out/cornell.exr --output out/cornell.png
	@echo "The Cornell box: $(CURDIR)/out/cornell.exr and $(CURDIR)/out/cornell.png"

# All tests; then the kernels that walk trees in subgroups of 4 and 16, kernels with storage buffers as on graphics cards, and another driver.
test:
	scripts/setup.sh --tests
	cargo test --no-fail-fast
	cargo test --no-fail-fast $(HOT_RELOAD)
	cargo test --no-fail-fast $(MPI) -- ranks::
	LP_NATIVE_VECTOR_WIDTH=128 cargo test --test gpu -- visibility:: traversal:: checks::eye:: checks::light::
	LIGHTSUM_NO_TEXELS=1 cargo test --test gpu -- visibility:: checks::
	LP_NATIVE_VECTOR_WIDTH=512 cargo test --test gpu -- --test-threads=1 visibility::
	scripts/swiftshader.sh cargo test --test gpu -- visibility:: traversal::clusters_may
	cargo test --test cli -- --ignored drivers::
	cargo run --quiet --manifest-path examples/wgpu/Cargo.toml

test-swiftshader:
	scripts/setup.sh --tests
	scripts/swiftshader.sh cargo test --test gpu

test-web:
	scripts/setup.sh
	scripts/test-web.sh

test-wgpu:
	scripts/setup.sh
	cargo run --quiet --manifest-path examples/wgpu/Cargo.toml

bench:
	scripts/setup.sh
	cargo run --release --quiet --bin lightsum-bench -- frame

lint:
	cargo fmt --check
	cargo clippy --all-targets -- -D warnings
	cargo clippy $(HOT_RELOAD) --lib -- -D warnings
	RUSTDOCFLAGS=-Dwarnings cargo doc --no-deps
	scripts/public_api.sh
