# Everything starts from a fresh clone with Python 3.11+, pip, make and (on Debian or Ubuntu) apt.
# TORCH_INDEX: where to take torch from. PyPI's Linux build brings several GB of CUDA libraries; for the CPU build say
#   make demo TORCH_INDEX=https://download.pytorch.org/whl/cpu

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
TORCH := torch==2.13.0
LIBRARIES := service/console/node_modules/.package-lock.json service/manual/node_modules/.package-lock.json
MANUAL := service/manual/site/llms.txt

.DEFAULT_GOAL := help

help: ## Show this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-11s %s\n", $$1, $$2}'

install: $(VENV)/.service $(LIBRARIES) $(MANUAL) ## Install what the service needs into .venv
	@sh docker/system-packages.sh service fonts

demo: install $(VENV)/.tests ## Watermark a real asset through the service, end to end
	$(BIN)/python -m tests.demo

run: install ## Start the API and its worker on http://127.0.0.1:8080
	$(BIN)/python -m service

test: $(VENV)/.tests $(LIBRARIES) ## Run the checks and the whole test suite
	@sh docker/system-packages.sh service fonts tests
	@sh docker/node-packages.sh tests $(BIN)/python
	$(MAKE) check
	$(BIN)/python -m pytest -n auto --dist worksteal

check: $(VENV)/.tests ## Lint, check the format and the types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

survey: $(VENV)/.tests ## Watermark every file of MESHES=DIR and print a table of facts
	@sh docker/system-packages.sh service fonts tests
	@sh docker/node-packages.sh tests $(BIN)/python
	@$(BIN)/python -m tests.survey $(MESHES)

delivered: $(VENV)/.tests ## Mark every textured file of MESHES=DIR (COLOR=auto, none, ...) and print how far OCR reads it, and as clay
	@test -n "$(MESHES)" || { echo "usage: make delivered MESHES=DIR [COLOR=auto]"; exit 2; }
	@$(BIN)/python -m tests.delivered $(MESHES) $(if $(COLOR),--color "$(COLOR)")

formats: $(VENV)/.tests ## Mark every file of MESHES=DIR, write it in each format and print what is there when that is read again
	@test -n "$(MESHES)" || { echo "usage: make formats MESHES=DIR"; exit 2; }
	@$(BIN)/python -m tests.exported $(MESHES)

features: $(VENV)/.tests ## Mark the labelled files of MESHES=DIR and print how many marks stand on faces, logos, ...
	@test -n "$(MESHES)" || { echo "usage: make features MESHES=DIR"; exit 2; }
	@$(BIN)/python -m tests.features $(MESHES)

design: $(VENV)/.tests ## Mark every file of MESHES=DIR and print the shares of marks where no designer would put them
	@test -n "$(MESHES)" || { echo "usage: make design MESHES=DIR"; exit 2; }
	@$(BIN)/python -m tests.design $(MESHES)

labels: $(VENV)/.tests ## Label every file of MESHES=DIR (LABEL=cn, eu, ...) and print how high the letters are in pictures
	@test -n "$(MESHES)" || { echo "usage: make labels MESHES=DIR [LABEL=cn]"; exit 2; }
	@$(BIN)/python -m tests.labelled $(MESHES) $(if $(LABEL),--label $(LABEL))

lighter: $(VENV)/.tests ## Mark every file of MESHES=DIR with a preview model (TRIANGLES=20000) and print sizes, marks and OCR of both
	@test -n "$(MESHES)" || { echo "usage: make lighter MESHES=DIR [TRIANGLES=20000]"; exit 2; }
	@$(BIN)/python -m tests.lighter $(MESHES) $(if $(TRIANGLES),--triangles $(TRIANGLES))

verified: $(VENV)/.tests ## Mark every file of MESHES=DIR, attack it (ATTACKS="crop,noise") and print how many are read back
	@test -n "$(MESHES)" || { echo "usage: make verified MESHES=DIR [ATTACKS=...]"; exit 2; }
	@$(BIN)/python -m tests.verified $(MESHES) $(if $(ATTACKS),--attacks "$(ATTACKS)")

compared: $(VENV)/.tests ## Mark every file of MESHES=DIR, attack it (ATTACKS="crop,noise") and compare it with its original
	@test -n "$(MESHES)" || { echo "usage: make compared MESHES=DIR [ATTACKS=...]"; exit 2; }
	@$(BIN)/python -m tests.compared $(MESHES) $(if $(ATTACKS),--attacks "$(ATTACKS)")

bench: $(VENV)/.tests ## Compare seconds and memory with those at BEFORE=COMMIT (MESHES=DIR ASSETS="a b" RUNS=5 JSON=OUT)
	@test -n "$(BEFORE)" || { echo 'usage: make bench BEFORE=COMMIT [AFTER=COMMIT] [MESHES=DIR] [ASSETS="cow fox"] [RUNS=5] [JSON=OUT]'; exit 2; }
	@sh docker/system-packages.sh service
	@$(BIN)/python -m tests.bench $(BEFORE) $(if $(AFTER),--after $(AFTER)) $(if $(MESHES),--meshes $(MESHES)) \
		$(foreach each,$(ASSETS),--only $(each)) $(if $(RUNS),--runs $(RUNS)) $(if $(JSON),--json $(JSON))

copies: $(VENV)/.tests ## Mark each of FILES="FILE ..." over HTTP, make 1, 10 and 100 copies of it, and print what they took
	@test -n "$(FILES)" || { echo 'usage: make copies FILES="FILE ..."'; exit 2; }
	@sh docker/system-packages.sh service fonts
	@$(BIN)/python -m tests.copies $(FILES)

performance: $(VENV)/.tests ## Measure every file of MESHES=DIR and write the tables of service/docs/performance.md (OUT=DIR: the profile, too)
	@test -n "$(MESHES)" || { echo "usage: make performance MESHES=DIR [OUT=DIR]"; exit 2; }
	@sh docker/system-packages.sh service fonts
	@$(BIN)/python -m tests.performance $(MESHES) $(if $(OUT),--out $(OUT))

benchmark: $(VENV)/.tests ## Compare all methods on the files of MESHES=DIR; the report goes to OUT=DIR
	@sh docker/system-packages.sh service
	$(BIN)/meshmark benchmark $(MESHES) --out $(OUT)

ablation: $(VENV)/.tests ## The same for placement without one of its objective's terms each
	@sh docker/system-packages.sh service
	$(BIN)/meshmark benchmark $(MESHES) --out $(OUT) --counts 16 --methods objective

fuzz: $(VENV)/.tests ## Run 10,000 mutated files through the engine
	@sh docker/node-packages.sh tests $(BIN)/python
	$(BIN)/python -m tests.fuzz

audit: $(VENV)/.tests ## Look the pinned packages up in PyPI's advisories; needs the network
	@$(BIN)/pip install --quiet --quiet --constraint docker/constraints.txt --editable '.[audit]'
	@$(BIN)/python -m tests.audit

faults: $(VENV)/.tests ## Let every part fail in turn while 50 jobs run, and print what came of them
	@sh docker/system-packages.sh service fonts tests
	$(BIN)/python -m tests.faults

load: $(VENV)/.tests ## Let 500 jobs, large uploads and a store that hangs come to the whole service, and print what it took
	@sh docker/system-packages.sh service fonts tests
	$(BIN)/python -m tests.load $(LOAD)

attacks: $(VENV)/.tests ## Attack an API as one tenant, and print what it answers another meanwhile
	$(BIN)/python -m tests.attacks

docker-test: ## Build the image and put the whole deployment through its faults, as root; CACHE=DIR keeps what it built
	$(PYTHON) -m tests.docker $(if $(CACHE),--cache $(CACHE))

pictures: $(VENV)/.tests ## Draw the manual's pictures of what parameters do and metrics measure
	@sh docker/system-packages.sh service fonts
	$(BIN)/python -m tests.pictures

openapi: $(VENV)/.service ## Write openapi.yaml from the application
	$(BIN)/python -m service openapi > openapi.yaml

clean: ## Remove everything that was installed or written here
	rm -rf $(VENV) tests/node_modules service/console/node_modules service/manual/node_modules service/manual/site demo-output data *.egg-info

$(VENV)/.service: pyproject.toml docker/constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --quiet --upgrade pip
	$(BIN)/pip install --quiet --quiet $(TORCH) $(if $(TORCH_INDEX),--index-url $(TORCH_INDEX))
	$(BIN)/pip install --quiet --quiet --constraint docker/constraints.txt --editable '.[docs]'
	touch $@

service/%/node_modules/.package-lock.json: service/%/package-lock.json $(VENV)/.service
	@sh docker/node-packages.sh service/$* $(BIN)/python
	touch $@

$(MANUAL): $(VENV)/.service $(LIBRARIES) openapi.yaml core/errors.py service/errors.py \
		$(wildcard service/docs/*.md service/docs/pictures/* service/manual/*.* service/manual/assets/*)
	$(BIN)/python -m service.manual

$(VENV)/.tests: $(VENV)/.service
	$(BIN)/pip install --quiet --quiet --constraint docker/constraints.txt --editable '.[test,benchmark]'
	touch $@

.PHONY: help install demo run test check survey delivered formats features design labels verified compared lighter copies bench performance benchmark ablation fuzz faults load attacks audit docker-test pictures openapi clean
