# Palpate: `make help` lists the targets. Out-of-source: everything is built below $(BUILD).

VERSION := 0.1.0
ABI     := 0
CC      ?= gcc
BUILD   ?= build
PREFIX  ?= /usr/local
prefix  ?= $(PREFIX)
DESTDIR ?=
# plain | asan | ubsan | tsan | coverage; the asan, ubsan, tsan targets set it
VARIANT ?= plain
# make test T=mls runs only the tests whose name contains "mls"
T       ?=
# V=1 shows every command
V       ?=
Q       := $(if $(V),,@)
JOBS    ?= $(shell nproc 2>/dev/null || echo 2)

# ---- The one list of Debian packages ---------------------------------------------------------
# Needed to build, run the demo and run all tests (`make deps` installs what is missing); g++ only for
# the test that compiles the installed headers as C++.
PACKAGES := gcc g++ libc6-dev make pkg-config \
	libhdf5-dev hdf5-tools \
	libsuitesparse-dev libopenblas-dev liblapacke-dev libarpack2-dev \
	libgmsh-dev libassimp-dev libyaml-dev \
	libjansson-dev libcmocka-dev \
	libepoxy-dev libegl-dev libgl-dev libegl1 libgl1-mesa-dri libpng-dev libgif-dev \
	libcairo2-dev fonts-dejavu-core libglfw3-dev libcglm-dev xvfb xauth \
	gnuplot-nox rt-tests
# Needed only by check, lint, format, fuzz, docs and the load of some benches.
PACKAGES_CHECK := clang clang-format clang-tidy cppcheck valgrind libclang-rt-14-dev doxygen stress-ng

# ---- Flags -----------------------------------------------------------------------------------
# -ffp-contract=off: a fused multiply-add rounds once where a*b+c rounds twice. Whether the compiler
# fuses depends on compiler, level and target, so forces would differ between builds of the same
# source; the tick promises the same bits everywhere. Kernels that want FMA ask for it by intrinsic,
# in every variant.
STD      := -std=c17 -D_GNU_SOURCE -DPALPATE_VERSION='"$(VERSION)"'
WARN     := -Wall -Wextra -Wpedantic -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wvla -Wundef \
            -Wcast-qual -Wwrite-strings -Wdouble-promotion -Wformat=2 -Wpointer-arith -Wnull-dereference
OPT      ?= -O2 -g
CFLAGS   ?=
WERROR   ?= -Werror
FPFLAGS  := -ffp-contract=off -fno-math-errno
SANITIZE_asan     := -fsanitize=address,undefined -fno-sanitize-recover=undefined -fno-omit-frame-pointer
SANITIZE_ubsan    := -fsanitize=undefined -fno-sanitize-recover=undefined -fno-omit-frame-pointer
SANITIZE_tsan     := -fsanitize=thread -fno-omit-frame-pointer
SANITIZE_coverage := --coverage -O1 -fno-inline
SANITIZE_fuzz     := -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=undefined -fno-omit-frame-pointer
SANITIZE := $(SANITIZE_$(VARIANT))
# linked into what the sanitized tests run
LEAKS    := $(if $(filter asan,$(VARIANT)),$(BUILD)/obj/tests/leaks.o)
ifneq ($(VARIANT),plain)
# warnings that sanitizer instrumentation makes up must not stop a sanitizer build
WERROR   :=
endif

ONLINE_PC  := hdf5-serial
OFFLINE_PC := yaml-0.1 lapacke openblas
PROGRAM_PC := jansson epoxy egl libpng cairo glfw3 cglm
pc-cflags   = $(shell pkg-config --cflags $(1) 2>/dev/null)
pc-libs     = $(shell pkg-config --libs $(1) 2>/dev/null)

ALL_CFLAGS   = $(STD) $(WARN) $(WERROR) $(OPT) $(FPFLAGS) $(SANITIZE) -fPIC -fvisibility=hidden \
               -pthread -Iinclude -I. $(CFLAGS)
ONLINE_LIBS  = $(call pc-libs,$(ONLINE_PC)) -lpthread -lm
OFFLINE_LIBS = -lumfpack -lcholmod -lamd -lcolamd -lccolamd -lcamd -lsuitesparseconfig -larpack \
               $(call pc-libs,$(OFFLINE_PC)) -lpthread -lm
PROGRAM_LIBS = $(call pc-libs,$(PROGRAM_PC)) -lgif -ldl -lpthread -lm
MESHER_LIBS  = -lgmsh -lm
READER_LIBS  = $(call pc-libs,assimp) -lm

# ---- Sources: a folder is a component --------------------------------------------------------
ONLINE_SRC  := $(filter-out haptic/program/% haptic/view/%,$(wildcard haptic/*/*.c))
OFFLINE_SRC := $(filter-out src/mesher/% src/reader/%,$(wildcard src/*.c src/*/*.c))
MESHER_SRC  := $(wildcard src/mesher/*.c)
READER_SRC  := $(wildcard src/reader/*.c)
VIEW_SRC    := $(wildcard haptic/view/*.c)
PROGRAM_SRC := $(wildcard haptic/program/*.c)
TEST_SRC    := $(wildcard tests/*/test_*.c)
TEST_AUX    := $(filter-out $(TEST_SRC),$(wildcard tests/support/*.c))
TEST_SH     := $(wildcard tests/*/test_*.sh)
BENCH_SRC   := $(wildcard bench/*.c)

obj = $(patsubst %.c,$(BUILD)/obj/%.o,$(1))
ONLINE_OBJ  := $(call obj,$(ONLINE_SRC))
OFFLINE_OBJ := $(call obj,$(OFFLINE_SRC))
MESHER_OBJ  := $(call obj,$(MESHER_SRC))
READER_OBJ  := $(call obj,$(READER_SRC))
VIEW_OBJ    := $(call obj,$(VIEW_SRC))
PROGRAM_OBJ := $(call obj,$(PROGRAM_SRC))
TEST_BIN    := $(patsubst %.c,$(BUILD)/%,$(TEST_SRC))
BENCH_BIN   := $(patsubst bench/%.c,$(BUILD)/bench/%,$(BENCH_SRC))

LIB_A      := $(BUILD)/libpalpate.a
LIB_SO     := $(BUILD)/libpalpate.so.$(ABI)
OFFLINE_A  := $(BUILD)/libpalpate-offline.a
OFFLINE_SO := $(BUILD)/libpalpate-offline.so.$(ABI)
VIEW_A     := $(BUILD)/libpalpate-view.a
PROGRAM    := $(if $(PROGRAM_SRC),$(BUILD)/palpate)
MESHER     := $(if $(MESHER_SRC),$(BUILD)/palpate-mesher)
READER     := $(BUILD)/palpate-reader
OFFLINE    := $(if $(OFFLINE_SRC),$(OFFLINE_A) $(OFFLINE_SO))

.DEFAULT_GOAL := all
.PHONY: all help deps deps-check demo test check bench install uninstall clean format lint docs \
        trainer asan ubsan tsan coverage build-all build-tests run-tests print-config

all: build-all ## build libraries and programs

help: ## list the targets
	@awk -F ':.*## ' '/^[a-zA-Z_%-]+:.*## /{printf "  %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@echo "  variables: BUILD=$(BUILD) PREFIX=$(PREFIX) VARIANT=$(VARIANT) OPT='$(OPT)' T='$(T)'"

print-config: ## show compiler, flags and library versions
	@echo "version $(VERSION), ABI $(ABI), $(shell $(CC) --version | head -1)"
	@echo "CFLAGS  $(ALL_CFLAGS)"
	@for p in $(ONLINE_PC) $(OFFLINE_PC) $(PROGRAM_PC); do \
		echo "$$p $$(pkg-config --modversion $$p 2>/dev/null || echo missing)"; done

# ---- Set-up ----------------------------------------------------------------------------------
deps: ## install missing Debian packages (root or sudo)
	@sh .ci/deps.sh $(PACKAGES)

deps-check: ## the same for lint, format, sanitizers and docs
	@sh .ci/deps.sh $(PACKAGES) $(PACKAGES_CHECK)

# ---- Build -----------------------------------------------------------------------------------
build-all: $(LIB_A) $(LIB_SO) $(OFFLINE) $(MESHER) $(READER) $(PROGRAM)

# per-component include flags
$(ONLINE_OBJ): EXTRA = $(call pc-cflags,$(ONLINE_PC))
# the tick's small loops gain 7 % (bench/ticks)
$(call obj,$(wildcard haptic/contact/*.c haptic/solver/*.c haptic/base/dense.c)): EXTRA += $(patsubst -O2,-O3,$(filter -O2,$(OPT)))
# gcc 12 makes fmaddsub of straight-line code for FMA targets although told not to contract (make golden)
$(call obj,haptic/base/pose.c): EXTRA += -fno-tree-slp-vectorize
$(OFFLINE_OBJ): EXTRA = $(call pc-cflags,$(OFFLINE_PC)) -isystem /usr/include/suitesparse
# a model's hash covers the sources that made it: see scene_hash.c
OFFLINE_TEXT := $(sort $(OFFLINE_SRC) $(MESHER_SRC) $(READER_SRC) $(wildcard src/*.h src/*/*.h))
$(call obj,src/scene/scene_hash.c): EXTRA += -DPALPATE_SOURCES_DIGEST='"$(shell cat $(OFFLINE_TEXT) | sha256sum | cut -c1-32)"'
$(call obj,src/scene/scene_hash.c): $(OFFLINE_TEXT)
$(VIEW_OBJ) $(PROGRAM_OBJ): EXTRA = $(call pc-cflags,$(PROGRAM_PC))

$(BUILD)/obj/%.o: %.c
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CC   $<")
	$(Q)$(CC) $(ALL_CFLAGS) $(EXTRA) -MMD -MP -c $< -o $@

# archives are made anew: a removed source must not live on in them
$(LIB_A): $(ONLINE_OBJ)
	$(Q)rm -f $@ && ar rcs $@ $^
$(OFFLINE_A): $(OFFLINE_OBJ)
	$(Q)rm -f $@ && ar rcs $@ $^
$(VIEW_A): $(VIEW_OBJ)
	$(Q)rm -f $@ && ar rcs $@ $^

RPATH := -Wl,--enable-new-dtags -Wl,-rpath,'$$ORIGIN:$$ORIGIN/../lib'
$(LIB_SO): $(ONLINE_OBJ)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE) -shared -Wl,-soname,libpalpate.so.$(ABI) -Wl,--no-undefined $(RPATH) $^ $(ONLINE_LIBS) $(LDFLAGS) -o $@
	$(Q)ln -sf libpalpate.so.$(ABI) $(BUILD)/libpalpate.so
$(OFFLINE_SO): $(OFFLINE_OBJ) $(LIB_SO)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE) -shared -Wl,-soname,libpalpate-offline.so.$(ABI) -Wl,--no-undefined $(RPATH) $(OFFLINE_OBJ) -L$(BUILD) -l:libpalpate.so.$(ABI) $(OFFLINE_LIBS) $(LDFLAGS) -o $@
	$(Q)ln -sf libpalpate-offline.so.$(ABI) $(BUILD)/libpalpate-offline.so

ifneq ($(MESHER),)
$(MESHER): $(MESHER_OBJ)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE) $^ $(MESHER_LIBS) $(LDFLAGS) -o $@
endif
$(READER_OBJ): EXTRA = $(call pc-cflags,assimp)
$(READER): $(READER_OBJ)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE) $^ $(READER_LIBS) $(LDFLAGS) -o $@
ifneq ($(PROGRAM),)
$(PROGRAM): $(PROGRAM_OBJ) $(LEAKS) $(VIEW_A) $(LIB_SO) $(OFFLINE_SO)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE) -rdynamic $(RPATH) $(PROGRAM_OBJ) $(LEAKS) $(VIEW_A) -L$(BUILD) -l:libpalpate.so.$(ABI) $(PROGRAM_LIBS) $(ONLINE_LIBS) $(LDFLAGS) -o $@
endif

# ---- Demo ------------------------------------------------------------------------------------
demo: deps ## install what is missing, build, precompute the default scene, replay 10 s at 1 kHz
	@$(MAKE) --no-print-directory -j$(JOBS) build-all
	@$(MAKE) --no-print-directory run-demo

.PHONY: run-demo
run-demo:
	@echo "== precompute scenes/hemisphere.yaml (cached after the first time)"
	@$(PROGRAM) precompute scenes/hemisphere.yaml
	@echo
	@echo "== replay of a press, 10 s at 1 kHz with the render thread, in slices alternating with a bare loop"
	@$(PROGRAM) run scenes/hemisphere.yaml --for 10 --reference 0.1 --snapshot $(BUILD)/demo.png
	@echo
	@echo "== the same 10 s in freewheel: every tick evaluated, as fast as it goes"
	@$(PROGRAM) run scenes/hemisphere.yaml --for 10 --freewheel --no-draw
	@echo
	@echo "look at $(BUILD)/demo.png; next: $(PROGRAM) view scenes/organ.yaml --mouse"

# ---- Tests: every tests/*/test_*.c is a cmocka program, every test_*.sh prints TAP --------------
TEST_AUX_OBJ := $(call obj,$(TEST_AUX))
$(call obj,$(TEST_SRC) $(TEST_AUX)): EXTRA = $(call pc-cflags,$(ONLINE_PC) $(OFFLINE_PC) $(PROGRAM_PC)) -isystem /usr/include/suitesparse
$(TEST_BIN): $(BUILD)/tests/%: $(BUILD)/obj/tests/%.o $(TEST_AUX_OBJ) $(LEAKS) $(VIEW_A) $(OFFLINE_A) $(LIB_A)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE) $(filter %.o,$^) $(VIEW_A) $(OFFLINE_A) $(LIB_A) -lcmocka $(ONLINE_LIBS) $(OFFLINE_LIBS) $(PROGRAM_LIBS) $(LDFLAGS) -o $@

# the fuzz targets with a main of our own, over their seeds (test_fuzz_seeds.sh); see Fuzzing below
FUZZ_SRC  := $(wildcard tests/fuzz/fuzz_*.c)
FUZZ_MAIN := $(call obj,tests/fuzz/seeds_main.c)
FUZZ_AUX  := $(call obj,$(filter-out $(FUZZ_SRC) tests/fuzz/seeds_main.c,$(wildcard tests/fuzz/*.c)) tests/support/synthetic_model.c)
$(call obj,$(FUZZ_SRC)) $(FUZZ_AUX): EXTRA = $(call pc-cflags,$(ONLINE_PC))
SEEDS_BIN := $(patsubst tests/fuzz/fuzz_%.c,$(BUILD)/tests/fuzz/seeds_%,$(FUZZ_SRC))
$(SEEDS_BIN): $(BUILD)/tests/fuzz/seeds_%: $(BUILD)/obj/tests/fuzz/fuzz_%.o $(FUZZ_MAIN) $(FUZZ_AUX) $(OFFLINE_A) $(LIB_A)
	@mkdir -p $(@D)
	$(Q)$(CC) $(SANITIZE) $< $(FUZZ_MAIN) $(FUZZ_AUX) $(OFFLINE_A) $(LIB_A) $(ONLINE_LIBS) $(OFFLINE_LIBS) $(LDFLAGS) -o $@

build-tests: build-all $(TEST_BIN) $(SEEDS_BIN)
run-tests: build-tests
	@BUILD=$(BUILD) VARIANT=$(VARIANT) CC="$(CC)" JOBS=$(JOBS) sh tests/run.sh "$(T)" $(TEST_BIN) $(TEST_SH)

test: deps ## install what is missing, build, run all tests
	@$(MAKE) --no-print-directory -j$(JOBS) run-tests

# instrumented programs take five to fifteen times as long as run.sh's 300 s are meant for
SLOW_TIMEOUT := 1800
check: ## what a change must pass, in one go: tests, sanitizers, valgrind, lint, golden hashes, coverage (long; goes on after Ctrl-C)
	@sh .ci/deps.sh $(PACKAGES) $(PACKAGES_CHECK)
	@MAKE="$(MAKE)" BUILD=$(BUILD) JOBS=$(JOBS) sh .ci/check
.PHONY: build-everything
build-everything: build-tests build-bench trainer $(BUILD)/soak

asan: ## build and run the tests with AddressSanitizer and UBSan
	@TEST_TIMEOUT=$(SLOW_TIMEOUT) $(MAKE) --no-print-directory -j$(JOBS) run-tests VARIANT=asan BUILD=$(BUILD)/asan
ubsan: ## build and run the tests with UBSan
	@$(MAKE) --no-print-directory -j$(JOBS) run-tests VARIANT=ubsan BUILD=$(BUILD)/ubsan
tsan: ## build and run the tests with ThreadSanitizer
	@TEST_TIMEOUT=$(SLOW_TIMEOUT) $(MAKE) --no-print-directory -j$(JOBS) run-tests VARIANT=tsan BUILD=$(BUILD)/tsan

# ---- Fuzzing: tests/fuzz/fuzz_NAME.c with its seeds in tests/fuzz/corpus/NAME ------------------
# `make test` runs every target over its seeds and fixed mutations of them (test_fuzz_seeds.sh)
FUZZ_SECONDS ?= 60
FUZZ_BIN  := $(patsubst %.c,$(BUILD)/%,$(FUZZ_SRC))
FUZZ_RUN   = $(strip $(foreach b,$(FUZZ_BIN),$(if $(or $(if $(T),,all),$(findstring $(T),$(notdir $(b)))),$(b))))
$(FUZZ_BIN): $(BUILD)/%: $(BUILD)/obj/%.o $(FUZZ_AUX) $(OFFLINE_A) $(LIB_A)
	@mkdir -p $(@D)
	$(Q)$(CC) -fsanitize=fuzzer,address,undefined $< $(FUZZ_AUX) $(OFFLINE_A) $(LIB_A) $(ONLINE_LIBS) $(OFFLINE_LIBS) $(LDFLAGS) -o $@
# no reader enters these two, and clang takes minutes to instrument their unrolled loops
ifeq ($(VARIANT),fuzz)
$(call obj,haptic/engine/field.c src/solution/lu_solve.c): SANITIZE =
endif
.PHONY: fuzz run-fuzz build-fuzz
fuzz: ## fuzz every reader of files for FUZZ_SECONDS (60) each, T=scene only that one
	@sh .ci/deps.sh $(PACKAGES) clang libclang-rt-14-dev
	@$(MAKE) --no-print-directory -j$(JOBS) run-fuzz VARIANT=fuzz CC=clang OPT='-O1 -g' BUILD=$(BUILD)/fuzz
build-fuzz: $(FUZZ_BIN) $(READER)
run-fuzz: $(FUZZ_RUN) $(READER)
	@for b in $(FUZZ_RUN); do n=$${b##*/fuzz_}; mkdir -p $(BUILD)/corpus/$$n && echo "== $$n" && \
		ASAN_OPTIONS=quarantine_size_mb=64:allocator_may_return_null=1 PALPATE_READER=$(abspath $(READER)) $$b -max_total_time=$(FUZZ_SECONDS) -max_len=8192 -timeout=20 -rss_limit_mb=2048 \
		$$([ -f tests/fuzz/corpus/$$n.dict ] && echo -dict=tests/fuzz/corpus/$$n.dict) \
		-print_final_stats=1 -verbosity=1 -artifact_prefix=$(BUILD)/corpus/$$n- $(BUILD)/corpus/$$n \
		tests/fuzz/corpus/$$n 2>$(BUILD)/corpus/$$n.log || { tail -40 $(BUILD)/corpus/$$n.log; exit 1; }; \
		grep -E '^stat::number|DONE' $(BUILD)/corpus/$$n.log | tr '\n' ' '; echo; done

# ---- Golden hashes: one driver, the online library built in several ways (tests/golden) --------
GOLDEN := $(BUILD)/golden-driver
$(call obj,tests/golden/golden.c): EXTRA = $(call pc-cflags,$(ONLINE_PC))
$(GOLDEN): $(call obj,tests/golden/golden.c tests/support/synthetic_model.c) $(LIB_A)
	$(Q)$(CC) $(SANITIZE) $^ $(ONLINE_LIBS) $(LDFLAGS) -o $@
.PHONY: golden golden-driver
golden-driver: $(GOLDEN)
golden: ## the engine's forces bit for bit over compilers, levels and instruction sets; the offline stage's over BLAS kernels
	@sh .ci/deps.sh $(PACKAGES) clang
	@$(MAKE) --no-print-directory -j$(JOBS) build-all
	@PALPATE=$(PROGRAM) sh tests/golden/offline.sh
	@MAKE="$(MAKE)" BUILD=$(BUILD)/golden JOBS=$(JOBS) sh tests/golden/compare.sh

# ---- Soak: random use with random faults for as long as you like (tests/soak/soak.c) ------------
MINUTES  ?= 1
SOAK_OBJ := $(call obj,$(wildcard tests/soak/*.c) tests/support/synthetic_model.c)
$(call obj,$(wildcard tests/soak/*.c)): EXTRA = $(call pc-cflags,$(ONLINE_PC))
$(BUILD)/soak: $(SOAK_OBJ) $(OFFLINE_A) $(LIB_A)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE) $(SOAK_OBJ) $(OFFLINE_A) $(LIB_A) $(ONLINE_LIBS) $(OFFLINE_LIBS) $(LDFLAGS) -o $@
.PHONY: soak
soak: ## random but physical use with random faults, MINUTES=n (1) long, SEED=s to see the same again
	@$(MAKE) --no-print-directory -j$(JOBS) build-all $(BUILD)/soak
	@PALPATE_BUILD=$(abspath $(BUILD)) $(BUILD)/soak --minutes $(MINUTES) $(if $(SEED),--seed $(SEED))

# ---- Benches ---------------------------------------------------------------------------------
BENCH_AUX := $(call obj,$(wildcard bench/support/*.c) tests/support/synthetic_model.c tests/support/closed_loop.c)
$(call obj,$(BENCH_SRC) $(wildcard bench/support/*.c)): EXTRA = $(call pc-cflags,$(ONLINE_PC) $(OFFLINE_PC) jansson) -isystem /usr/include/suitesparse
$(BENCH_BIN): $(BUILD)/bench/%: $(BUILD)/obj/bench/%.o $(BENCH_AUX) $(OFFLINE_A) $(LIB_A)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CC) $(SANITIZE) $(filter %.o,$^) $(OFFLINE_A) $(LIB_A) $(ONLINE_LIBS) $(OFFLINE_LIBS) -ljansson $(LDFLAGS) -o $@
.PHONY: build-bench
build-bench: build-all $(BENCH_BIN) ## build the benches, run none
bench: deps ## build and run every bench (long)
	@$(MAKE) --no-print-directory -j$(JOBS) build-bench
	@for b in $(BENCH_BIN); do echo "== $$b"; $$b || exit 1; done
bench-%: ## build and run one bench, e.g. make bench-tick
	@$(MAKE) --no-print-directory -j$(JOBS) build-all $(BUILD)/bench/$*
	@mkdir -p bench/results && $(BUILD)/bench/$* $(ARGS)

# ---- An example host: installed headers and libpalpate only, never part of the program ----------
trainer: $(LIB_SO) ## build the example trainer, a host that embeds libpalpate
	$(Q)$(CC) $(STD) $(WARN) $(WERROR) $(OPT) -Iinclude haptic/program/embed/trainer.c $(RPATH) -L$(BUILD) -l:libpalpate.so.$(ABI) -pthread -lm -o $(BUILD)/trainer
	@echo "$(BUILD)/trainer MODEL [SECONDS [MESH.obj SCALE [OUT.obj]]]"

# ---- Install ---------------------------------------------------------------------------------
bindir     := $(DESTDIR)$(prefix)/bin
libdir     := $(DESTDIR)$(prefix)/lib
libexecdir := $(DESTDIR)$(prefix)/libexec/palpate
includedir := $(DESTDIR)$(prefix)/include/palpate
datadir    := $(DESTDIR)$(prefix)/share/palpate
mandir     := $(DESTDIR)$(prefix)/share/man/man1

install: build-all ## install below $(DESTDIR)$(prefix)
	install -d $(bindir) $(libdir)/pkgconfig $(libexecdir) $(includedir) $(datadir)/scenes/trajectories $(mandir)
	install -m 755 $(PROGRAM) $(bindir)/
	install -m 755 $(MESHER) $(READER) $(libexecdir)/
	install -m 755 $(LIB_SO) $(OFFLINE_SO) $(libdir)/
	install -m 644 $(LIB_A) $(OFFLINE_A) $(libdir)/
	ln -sf libpalpate.so.$(ABI) $(libdir)/libpalpate.so
	ln -sf libpalpate-offline.so.$(ABI) $(libdir)/libpalpate-offline.so
	install -m 644 include/palpate/*.h $(includedir)/
	install -m 644 $(wildcard scenes/*.yaml scenes/*.obj) $(datadir)/scenes/
	install -m 644 $(wildcard scenes/trajectories/*.csv) $(datadir)/scenes/trajectories/
	install -m 644 .ci/palpate.1 $(mandir)/palpate.1
	sed -e 's|@prefix@|$(prefix)|' -e 's|@version@|$(VERSION)|' .ci/palpate.pc.in > $(libdir)/pkgconfig/palpate.pc
	sed -e 's|@prefix@|$(prefix)|' -e 's|@version@|$(VERSION)|' .ci/palpate-offline.pc.in > $(libdir)/pkgconfig/palpate-offline.pc

uninstall: ## remove what install put there
	rm -f $(bindir)/palpate $(libexecdir)/palpate-mesher $(libexecdir)/palpate-reader $(mandir)/palpate.1
	rm -f $(libdir)/libpalpate.a $(libdir)/libpalpate.so* $(libdir)/libpalpate-offline.a $(libdir)/libpalpate-offline.so*
	rm -f $(libdir)/pkgconfig/palpate.pc $(libdir)/pkgconfig/palpate-offline.pc
	rm -rf $(includedir) $(datadir) $(libexecdir)

# ---- Tidy ------------------------------------------------------------------------------------
ALL_SRC := $(ONLINE_SRC) $(OFFLINE_SRC) $(MESHER_SRC) $(READER_SRC) $(VIEW_SRC) $(PROGRAM_SRC)
ALL_FILES := $(ALL_SRC) $(wildcard include/palpate/*.h haptic/*/*.h haptic/program/embed/*.c src/*.h src/*/*.h \
             tests/*/*.[ch] bench/*.[ch] bench/support/*.[ch])

clean: ## remove everything built
	rm -rf $(BUILD)

format: ## clang-format every source in place
	@clang-format -i $(ALL_FILES)

# not these: cppcheck 2.10 takes &p->array[i] for the address of a variable, and a test of the next
# item's number for one of the index
# gcc 12's analyzer loses track of arrays filled in loops and of what a struct owns
ANALYZER_NOT := -Wno-analyzer-use-of-uninitialized-value -Wno-analyzer-null-dereference \
                -Wno-analyzer-null-argument -Wno-analyzer-malloc-leak
CPPCHECK_NOT := objectIndex arrayIndexThenCheck missingIncludeSystem
TIDY_FLAGS = -std=c17 -D_GNU_SOURCE -DPALPATE_VERSION=__FILE__ -Iinclude -I. -isystem /usr/include/suitesparse \
	$(call pc-cflags,$(ONLINE_PC) $(OFFLINE_PC) $(PROGRAM_PC) assimp)
.PHONY: cppcheck tidy analyzer
lint: cppcheck tidy analyzer ## cppcheck, clang-tidy and gcc -fanalyzer over the libraries and the programs
cppcheck:
	@sh .ci/deps.sh $(PACKAGES) cppcheck
	cppcheck --quiet --std=c11 --enable=warning,portability --inline-suppr $(CPPCHECK_NOT:%=--suppress=%) \
		--error-exitcode=1 -j$(JOBS) -Iinclude -I. -DPALPATE_VERSION='"x"' $(ALL_SRC)
tidy:
	@sh .ci/deps.sh $(PACKAGES) clang-tidy
	@printf '%s\n' $(ALL_SRC) | xargs -P$(JOBS) -I{} sh -c 'echo "  TIDY {}"; clang-tidy --quiet --warnings-as-errors="*" {} -- $(TIDY_FLAGS) 2>/dev/null'
analyzer:
	@$(MAKE) --no-print-directory BUILD=$(BUILD)/analyzer CFLAGS='-fanalyzer -DPALPATE_ANALYZER $(ANALYZER_NOT)' OPT=-O1 -j$(JOBS) build-all

docs: build-all ## reference of the C API (doxygen) and of the scene's keys, below $(BUILD)/docs
	@sh .ci/deps.sh doxygen
	@mkdir -p $(BUILD)/docs
	@(echo 'PROJECT_NAME=Palpate'; echo 'PROJECT_NUMBER=$(VERSION)'; \
	  echo 'INPUT=include $(CURDIR)/README.md scenes/README.md tests/README.md haptic/program/embed'; \
	  echo 'WARN_IF_INCOMPLETE_DOC=NO'; \
	  echo 'RECURSIVE=YES'; echo 'OUTPUT_DIRECTORY=$(BUILD)/docs'; echo 'GENERATE_LATEX=NO'; \
	  echo 'QUIET=YES'; echo 'HAVE_DOT=NO'; echo 'EXTRACT_ALL=YES'; echo 'OPTIMIZE_OUTPUT_FOR_C=YES'; \
	  echo 'PREDEFINED=__attribute__(x)='; echo 'USE_MDFILE_AS_MAINPAGE=$(CURDIR)/README.md') | doxygen -
	@$(PROGRAM) schema > $(BUILD)/docs/scene-keys.txt
	@echo "$(BUILD)/docs/html/index.html $(BUILD)/docs/scene-keys.txt"

VALGRIND_TESTS ?= output watchdog pose ring pace quantiles hash trajectory status replay snapshot device \
                  press model near_field contact
.PHONY: memcheck
memcheck: build-tests ## the small tests under valgrind
	@mkdir -p $(BUILD)/memcheck
	@printf '%s\n' $(VALGRIND_TESTS) | xargs -P$(JOBS) -I{} sh -c 'valgrind -q --leak-check=full \
		--errors-for-leak-kinds=definite --error-exitcode=9 $(BUILD)/tests/haptic/test_{} >$(BUILD)/memcheck/{}.log 2>&1 && \
		echo "  VALGRIND test_{}" || { cat $(BUILD)/memcheck/{}.log; echo "test_{} FAILED under valgrind"; exit 1; }'

coverage: ## line coverage of the libraries by the tests
	@TEST_TIMEOUT=$(SLOW_TIMEOUT) $(MAKE) --no-print-directory -j$(JOBS) run-tests VARIANT=coverage OPT=-g BUILD=$(BUILD)/coverage
	@sh .ci/coverage.sh $(BUILD)/coverage 90

-include $(shell find $(BUILD)/obj -name '*.d' 2>/dev/null)
