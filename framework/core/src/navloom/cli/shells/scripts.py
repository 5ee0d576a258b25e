"""Completion scripts: a script contains all commands and options, and asks `navloom __complete` for values."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence

from navloom.cli.shells.tree import CommandEntry, Word

__all__ = ["SCRIPTS"]

SHELLS = "bash zsh fish"
"""Values of the argument of `navloom completion`."""

BASH = r"""# bash completion of navloom, made by `navloom completion bash`

_navloom_command() {
    case "$1" in
@COMMANDS@
    esac
}

_navloom_propose() {
    local line
    while IFS= read -r line; do
        COMPREPLY+=("$line")
    done < <(compgen "$@" -- "$cur")
}

_navloom() {
    local program=${COMP_WORDS[0]/#\~/$HOME} cur=${COMP_WORDS[COMP_CWORD]} path=navloom
    local commands options values arguments option= kind= word i position=0
    COMPREPLY=()
    _navloom_command "$path"
    for ((i = 1; i < COMP_CWORD; i++)); do
        word=${COMP_WORDS[i]}
        if [[ $word == "=" ]]; then
            continue # --out=DIR is three words here
        elif [[ -n $option ]]; then
            option=
        elif [[ $word == -* ]]; then
            [[ $values == *" $word:"* ]] && option=$word
        elif [[ $commands == *" $word "* ]]; then
            path="$path $word"
            _navloom_command "$path"
        else
            position=$((position + 1))
        fi
    done
    [[ $cur == "=" ]] && cur=
    if [[ -n $option ]]; then
        kind=${values#*" $option:"}
        kind=${kind%% *}
    elif [[ $cur == -* ]]; then
        _navloom_propose -W "$options"
    elif [[ -n ${commands// /} ]]; then
        _navloom_propose -W "$commands"
    elif ((position < ${#arguments[@]})); then
        kind=${arguments[position]}
    elif ((${#arguments[@]})) && [[ ${arguments[${#arguments[@]} - 1]} == *+ ]]; then
        kind=${arguments[${#arguments[@]} - 1]}
    fi
    case ${kind%+} in
    "" | none) ;;
    shells) _navloom_propose -W "@SHELLS@" ;;
    folders) _navloom_propose -d ;;
    files) _navloom_propose -f ;;
    *)
        _navloom_propose -W "$("$program" __complete "${kind%+}" 2>/dev/null)"
        case ${kind%+} in
        configs) _navloom_propose -f -X '!*.toml' && _navloom_propose -d ;;
        worlds) _navloom_propose -f ;;
        esac
        ;;
    esac
    [[ ${kind%+} =~ ^(folders|files|configs|worlds)$ ]] && compopt -o filenames 2>/dev/null
    return 0
}

complete -F _navloom navloom
"""

ZSH = r"""#compdef navloom
# zsh completion of navloom, made by `navloom completion zsh`

_navloom_values() { # options of compadd, then what to propose
    local -a found
    found=(${(f)"$($_navloom_program __complete $@[-1] 2>/dev/null)"})
    compadd "${@[1,-2]}" -a found
    case $@[-1] in
    configs) _files -g '*.toml' ;;
    worlds) _files ;;
    esac
    return 0
}

@GROUPS@

_navloom "$@"
"""

ZSH_GROUP = r"""@FUNCTION@() {
    local _navloom_program=${_navloom_program:-${words[1]/#\~/$HOME}} # also for groups within
    local curcontext=$curcontext state line
    local -a commands
    _arguments -C \
@OPTIONS@
        '1: :->command' '*::argument:->rest'
    case $state in
    command)
        commands=(
@NAMES@
        )
        _describe -t commands command commands
        ;;
    rest)
        case $line[1] in
@CASES@
        esac
        ;;
    esac
}
"""

FISH = r"""# fish completion of navloom, made by `navloom completion fish`

function __navloom_at
    # Whether the command line is at this command: its first words are those.
    set -l words (string match -v -- '-*' (commandline -opc)[2..-1])
    set -l first $words[1..(count $argv)]
    test "$first" = "$argv"
end

function __navloom_in
    # Whether the command line is at this group, and its command is still to come.
    set -l words (string match -v -- '-*' (commandline -opc)[2..-1])
    test "$words" = "$argv"
end

function __navloom_values
    set -l program (string replace -r '^~' $HOME -- (commandline -opc)[1])
    $program __complete $argv 2>/dev/null
end

complete -c navloom -f
@LINES@
"""


def bash(tree: Sequence[CommandEntry]) -> str:
    """The script for bash."""
    return _filled(BASH, COMMANDS="\n".join(map(_bash_case, tree)), SHELLS=SHELLS)


def _bash_case(command: CommandEntry) -> str:
    options = " ".join(name for word in command.options for name in word.names)
    values = " ".join(
        f"{name}:{word.kind or 'none'}" for word in command.options if word.metavar for name in word.names
    )
    arguments = " ".join((word.kind or "none") + "+" * word.repeats for word in command.arguments)
    return (
        f'    "{command.name}") commands=" {" ".join(command.inner)} " options="{options}" '
        f'values=" {values} " arguments=({arguments}) ;;'
    )


def zsh(tree: Sequence[CommandEntry]) -> str:
    """The script for zsh."""
    by_path = {command.path: command for command in tree}
    groups = [_zsh_group(command, by_path) for command in tree if command.inner]
    return _filled(ZSH, GROUPS="\n".join(groups))


def _zsh_group(group: CommandEntry, by_path: Mapping[tuple[str, ...], CommandEntry]) -> str:
    inner = [by_path[(*group.path, name)] for name in group.inner]
    return _filled(
        ZSH_GROUP,
        FUNCTION="_" + "_".join(group.path),
        OPTIONS="\n".join(f"        {spec} \\" for word in group.options for spec in _zsh_option(word)),
        NAMES="\n".join(f"            {_quoted(f'{one.path[-1]}:{one.summary}')}" for one in inner),
        CASES="\n".join(_zsh_case(one) for one in inner),
    )


def _zsh_case(command: CommandEntry) -> str:
    name = command.path[-1]
    if command.inner:
        return f"        {name}) _{'_'.join(command.path)} ;;"
    specs = [spec for word in command.options for spec in _zsh_option(word)]
    for number, word in enumerate(command.arguments, 1):
        place = "*" if word.repeats else str(number) if word.needed else f"{number}:"
        specs.append(_quoted(f"{place}:{_escaped(word.metavar)}:{_zsh_action(word.kind)}"))
    return f"        {name}) _arguments -s {' '.join(specs)} ;;"


def _zsh_option(word: Word) -> Iterator[str]:
    for name in word.names:
        many, value = "*" if word.repeats else "", ""
        if word.metavar:
            value = f":{_escaped(word.metavar)}:{_zsh_action(word.kind)}"
        yield _quoted(f"{many}{name}{'=' if word.metavar else ''}[{_escaped(word.help)}]{value}")


def _zsh_action(kind: str) -> str:
    fixed = {"": " ", "shells": f"({SHELLS})", "folders": "_files -/", "files": "_files"}
    return fixed.get(kind, f"_navloom_values {kind}")


def _escaped(text: str) -> str:
    """Text escaped for a specification of zsh's _arguments."""
    return re.sub(r"([\\:\[\]])", r"\\\1", " ".join(text.split()))


def fish(tree: Sequence[CommandEntry]) -> str:
    """The script for fish."""
    return _filled(FISH, LINES="\n".join(line for command in tree for line in _fish_lines(command, tree)))


def _fish_lines(command: CommandEntry, tree: Sequence[CommandEntry]) -> Iterator[str]:
    words = " ".join(command.path[1:])
    if command.inner:
        here = f"complete -c navloom -n '__navloom_in {words}'"
        for entry in tree:
            if entry.path[:-1] == command.path:
                yield f"{here} -a {entry.path[-1]} -d {_quoted(entry.summary)}"
    else:
        here = f"complete -c navloom -n '__navloom_at {words}'"
        for word in command.arguments:
            if word.kind:
                yield f"{here} {_fish_values(word.kind)}"
    for word in command.options:
        names = " ".join(f"-l {name.removeprefix('--')}" for name in word.names)
        value = f" -r {_fish_values(word.kind)}" if word.metavar else ""
        yield f"{here} {names}{value} -d {_quoted(' '.join(word.help.split()))}"


def _fish_values(kind: str) -> str:
    fixed = {
        "": "-f",
        "shells": f"-f -a '{SHELLS}'",
        "folders": "-f -a '(__fish_complete_directories (commandline -ct))'",
        "files": "-F",
    }
    files = " -F" if kind in ("configs", "worlds") else " -f"
    return fixed.get(kind, f"-a '(__navloom_values {kind})'{files}")


def _quoted(text: str) -> str:
    """Text as one quoted word of a shell."""
    return "'" + text.replace("'", r"'\''") + "'"


def _filled(template: str, **parts: str) -> str:
    for name, text in parts.items():
        template = template.replace(f"@{name}@", text)
    return template


SCRIPTS: Mapping[str, Callable[[Sequence[CommandEntry]], str]] = {"bash": bash, "zsh": zsh, "fish": fish}
"""Function that writes the script, by shell."""
