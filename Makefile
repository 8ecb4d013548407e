# `make demo` and `make test` are all that a fresh machine needs; each first sets up what is missing.
SHELL := /bin/bash
# Bytecode is kept even if the environment says otherwise; without it, every new process would compile everything.
export PYTHONDONTWRITEBYTECODE :=
BIN := .venv/bin
STAMP := .venv/.installed
PACKAGES := common worker coordinator gepf benchmarks docs examples tests
KERNELS := $(BIN)/python -m tests.support.kernel.warm_tracker & tracker=$$!; \
    $(BIN)/python -m tests.support.kernel.warm_kernel && wait $$tracker

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-slow chaos hosts fuzz check docs format bench paper ablation real-people images images-test lock clean clean-kernels

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

setup: $(STAMP) ## virtual environment in .venv with gepf, gepf-worker and the tools

$(STAMP): pyproject.toml constraints.txt .ci/setup
	@.ci/setup .venv
	@# pip compiles nothing: what is loaded here starts in half the time from now on
	@$(BIN)/python -c 'import open3d, gepf.coordinator.commands.demo, gepf.worker.service'
	@echo 'setup: compiling the kernels, about a minute' >&2
	@$(KERNELS)
	@touch $@

demo: setup ## people who move fast, tracked with one particle and with many; table and pictures in demo/
	$(BIN)/gepf demo --out demo

test: setup ## the tests, four at once even on two cores, because many only wait; kernels are compiled first
	$(KERNELS)
	$(BIN)/python -m pytest -q -n 4 --dist worksteal --max-worker-restart 0

test-slow: setup ## the tests that take long
	$(BIN)/python -m pytest -q -m slow --timeout 3600

chaos: setup ## whether results keep the same bytes when workers are disturbed and coordinators are killed
	$(BIN)/python -m pytest -q -m slow --timeout 3600 tests/disturbance/test_chaos.py

fuzz: setup ## hostile messages against the decoders, a live worker and a live coordinator
	$(BIN)/python -m pytest -q -m slow --timeout 3600 tests/disturbance/test_fuzz.py

hosts: setup ## whether results keep the same bytes when hosts of coordinator, router and workers fail (as root)
	$(BIN)/python -m pytest -q -m slow --timeout 3600 tests/disturbance/test_hosts.py

check: setup docs ## lint, format, types, import rules, dependencies, Dockerfiles, documents
	$(BIN)/ruff check $(PACKAGES)
	$(BIN)/ruff format --check $(PACKAGES)
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/deptry common worker coordinator gepf
	$(BIN)/hadolint docker/*.Dockerfile
	$(BIN)/check-jsonschema --builtin-schema vendor.compose-spec docker/compose.yaml
	$(BIN)/kubernetes-validate --strict --quiet $(filter-out %/kustomization.yaml,$(wildcard docker/kubernetes/*.yaml)) \
		examples/batch/kubernetes.yaml

docs: setup ## documents and API reference as a site in site/; a broken link or an undescribed name is an error
	$(BIN)/python -m sphinx --quiet --fail-on-warning --fresh-env -c docs . site
	@cp site/README.html site/index.html

format: setup ## rewrite the code in the house style
	$(BIN)/ruff check --fix $(PACKAGES)
	$(BIN)/ruff format $(PACKAGES)

bench: setup ## cost of a particle against other ICPs, of the service against a process pool and Ray; frame rates
	$(BIN)/python -m benchmarks.costs.kernel
	$(BIN)/python -m benchmarks.costs.service
	$(BIN)/python -m benchmarks.costs.video_rate

paper: setup ## the paper's experiments and the baselines beside them: tables, numbers, pictures in docs/
	$(BIN)/python -m benchmarks.paper

ablation: setup ## each setting of preset default alone (needs ../shared/data)
	$(BIN)/python -m benchmarks.ablation

real-people: setup ## real and skinned people, scored (needs ../shared/data)
	$(BIN)/python -m benchmarks.people

images: ## container images of worker and coordinator, with docker, podman or buildah
	docker/build.sh worker coordinator

images-test: ## track with these images: router, two workers and coordinator in separate containers, with certificates
	docker/test.sh

lock: ## new pinned versions in constraints.txt: the newest that pyproject.toml allows
	@.ci/lock

clean-kernels: ## forget compiled kernels: the next start compiles them all
	find $(PACKAGES) \( -name '*.nbi' -o -name '*.nbc' \) -delete

clean: ## remove the virtual environment and all caches
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
	find $(PACKAGES) -name __pycache__ -type d -prune -exec rm -rf {} +
