# Everything runs in .venv; PYTHON is only what makes it (3.11 or newer).
PYTHON ?= $(shell for python in python3.11 python3.12 python3.13 python3; do \
	$$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2> /dev/null && echo $$python && break; done)
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready

DEMO := build/demo
# The filter of lee1997 told what this radar is like: a scan every 1.68 s, plots within 400 m, and a
# boat that is counted on past a full turn around the ship.
DEMO_RADAR := \
	--constant T=1.68 \
	--constant "sigma1_sq=(0.13*T)^2" \
	--constant "sigma2_sq=(0.0025*T)^2" \
	--constant "sigma_rho_sq=1.3^2" \
	--constant "sigma_theta_sq=0.025^2" \
	--constant "range_limit=400" \
	--constant "bearing_limit=2*pi"

.PHONY: demo test setup clean

demo: $(READY)
	$(BIN)/kalmanhdl build designs/lee1997.toml --data designs/data/autoferry_radar_target.csv \
		$(DEMO_RADAR) --seeds 2 --out $(DEMO) --force

test: $(READY)
	$(BIN)/pytest -n 2 $(PYTEST_OPTIONS)

setup: $(READY)

$(READY): pyproject.toml requirements.lock
	@test -n "$(PYTHON)" || { echo "no Python 3.11 or newer was found: name one, make PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $(READY)

clean:
	rm -rf build .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
