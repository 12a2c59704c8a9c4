# Sourced by the scripts that make environments: with uv where it is on PATH, else with venv and pip.
#
# A lock file is whole. So nothing is resolved: what has been released since then is not looked at,
# also not for building (`--no-build-isolation`).

if command -v uv >/dev/null; then uv=yes; else uv=; fi

runs() { # is $1 a Python $2, for example 3.11?
    "$1" -c "import sys; sys.exit('%d.%d' % sys.version_info[:2] != '$2')" >/dev/null 2>&1
}

interpreter() { # print the path of a Python $1, from PATH or from pyenv
    for candidate in "python$1" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$1".*/bin/python; do
        if runs "$candidate" "$1"; then
            echo "$candidate"
            return
        fi
    done
    echo "piezod: no Python $1 on PATH or in pyenv; install it: pyenv install $1" >&2
    return 1
}

make_environment() { # in the folder $1, with the Python $2
    if [ -n "$uv" ]; then
        uv venv --quiet --clear --python "$2" "$1"
    else
        "$2" -m venv --clear "$1"
    fi
}

pip_of() { # run pip for the environment $1, quietly
    python=$1/bin/python
    shift
    "$python" -m pip --quiet --disable-pip-version-check "$@"
}

install_lock() { # into the environment $1: what the lock file $2 pins, and nothing else
    if [ -n "$uv" ]; then
        uv pip sync --quiet --python "$1/bin/python" --no-build-isolation --require-hashes "$2"
    else
        pip_of "$1" install --no-deps --no-build-isolation --require-hashes --requirement "$2"
    fi
}

install_piezod() { # into the environment $1: this checkout, editable
    if [ -n "$uv" ]; then
        uv pip install --quiet --python "$1/bin/python" --no-deps --no-build-isolation --editable .
    else
        pip_of "$1" install --no-deps --no-build-isolation --editable .
    fi
}

check_whole() { # has the environment $1 all that its packages ask for?
    if [ -n "$uv" ]; then
        found=$(uv pip check --python "$1/bin/python" 2>&1) && return
    else
        found=$("$1/bin/python" -m pip --disable-pip-version-check check 2>&1) && return
    fi
    printf '%s\n' "$found" "piezod: $1 is not whole. If it is older than its lock file: make clean" >&2
    return 1
}
