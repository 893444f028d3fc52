# What `.ci/run` and `.ci/full` share: the steps, each in fresh clones of what is committed.
# shellcheck shell=bash
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
scratch=$(mktemp -d)
current="start"
finish() {
  local status=$?
  # shellcheck disable=SC2046
  kill $(jobs -p) 2>/dev/null || true
  rm -rf "$scratch"
  if [ "$status" -ne 0 ]; then echo "FAILED in: $current" >&2; fi
  exit "$status"
}
trap finish EXIT

export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
# Every process of the tests would compile everything anew.
unset PYTHONDONTWRITEBYTECODE
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore PIP_QUIET=1
if [ -z "${NICO_DATA:-}" ] && [ -d "$root/../shared/data" ]; then
  NICO_DATA=$(cd "$root/../shared/data" && pwd)
  export NICO_DATA
fi
if [ -z "${NICO_PICSERVO:-}" ] && [ -d "$root/../shared/picservo" ]; then
  NICO_PICSERVO=$(cd "$root/../shared/picservo" && pwd)
  export NICO_PICSERVO
fi

step() {
  current=$1
  printf '\n== %s (%d s)\n' "$1" "$SECONDS"
}

# Rendering needs an EGL driver, the browser tests Chromium, and Debian's Python lacks venv.
install_system_packages() {
  local package missing=()
  if ! command -v apt-get >/dev/null || [ "$(id -u)" -ne 0 ]; then return 0; fi
  for package in libegl1 libgl1-mesa-dri chromium; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q ' installed$' ||
      missing+=("$package")
  done
  python3 -c 'import ensurepip, venv' 2>/dev/null || missing+=(python3-venv)
  if [ "${#missing[@]}" -eq 0 ]; then return 0; fi
  step "system packages: ${missing[*]}"
  export DEBIAN_FRONTEND=noninteractive
  { apt-get update -q && apt-get install -q -y --no-install-recommends "${missing[@]}"; } \
    >"$scratch/apt.log" 2>&1 || { tail -n 40 "$scratch/apt.log"; return 1; }
}

# Print the interpreter itself: what stands on the PATH may be a shim that chooses by folder.
real_interpreter() { "$1" -c 'import sys; print(sys.executable)' 2>/dev/null; }

# Print the newest complete Python >= 3.12 that really runs, if there is one.
newest_interpreter() {
  local minor candidate
  for minor in 14 13 12; do
    for candidate in "python3.$minor" "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3."$minor".*/bin/python
    do
      if "$candidate" -c 'import ctypes, ensurepip, sqlite3, ssl, venv' 2>/dev/null; then
        real_interpreter "$candidate"
        return 0
      fi
    done
  done
}

# Run the README's command under <!-- $1 --> in a fresh clone $2; its python3 is $3.
run_readme_command() {
  local marker="<!-- $1 -->" clone="$scratch/$2" command
  command=$(awk -v marker="$marker" '
    $0 == marker { found = 1; next }
    found && /^```/ { if (inside) exit; inside = 1; next }
    inside { print }' "$root/README.md")
  if [ -z "$command" ]; then echo "README.md has no block under $marker" >&2; return 1; fi
  git clone -q "$root" "$clone"
  mkdir "$clone.bin"
  printf '#!/bin/sh\nexec "%s" "$@"\n' "$3" >"$clone.bin/python3"
  chmod +x "$clone.bin/python3"
  (cd "$clone" && PATH="$clone.bin:$PATH" bash -euo pipefail -c "$command")
  echo "with $("$clone/.venv/bin/pip" freeze | grep -i '^drake==')"
}

# Run every linter, even where an earlier one failed.
run_linters() {
  local failed=0
  cd "$scratch/tests"
  .venv/bin/pip install -q -e ".[dev]"
  .venv/bin/ruff check || failed=1
  .venv/bin/ruff format --check || failed=1
  .venv/bin/pyright || failed=1
  .venv/bin/lint-imports --no-logo || failed=1
  cd "$root"
  return "$failed"
}

# The two commands of the README, each in a clone and an environment of its own, and the linters.
gate() {
  local linters
  if [ -n "$(git -C "$root" status --porcelain)" ]; then
    echo "note: uncommitted changes are not tested"
  fi
  install_system_packages
  python=$(real_interpreter python3)
  newest=$(newest_interpreter)
  step "README, tests: $("$python" --version)"
  PYTEST_ADDOPTS="${1:-}" run_readme_command "test command" tests "$python"

  step "README, main command; ruff, pyright, import contracts beside it"
  run_linters >"$scratch/linters.log" 2>&1 &
  linters=$!
  run_readme_command "main command" main "$python"
  wait "$linters" || { cat "$scratch/linters.log"; return 1; }
  cat "$scratch/linters.log"
}

# Build the documentation: a warning, a dead link or a tutorial that fails ends it.
build_the_site() {
  "$scratch/tests/.venv/bin/pip" install -q -e "$scratch/tests[docs]"
  (cd "$scratch/tests" && NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build -q --strict -d "$scratch/site")
  test -s "$scratch/site/reference/systems/index.html"
}

# Put the wheel, built from the sdist, in place of the editable install and run it elsewhere.
try_the_wheel() {
  "$scratch/tests/.venv/bin/python" -m build "$scratch/tests" --outdir "$scratch/dist" \
    >"$scratch/build.log" 2>&1 || { tail -n 40 "$scratch/build.log"; return 1; }
  "$scratch/main/.venv/bin/pip" install -q --force-reinstall --no-deps "$scratch"/dist/*.whl
  (
    cd "$scratch"
    main/.venv/bin/python -c '
from importlib.resources import files
for name in ("py.typed", "urdf/nico.urdf", "urdf/package.xml"):
    assert files("nico_selfmodel").joinpath(name).is_file(), f"the wheel lacks {name}"
'
    main/.venv/bin/nico-selfmodel learn --sensor motion-capture --out learned_from_wheel
  )
}
