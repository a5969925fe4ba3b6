"""Completion of commands, options and their values by the shell."""

from __future__ import annotations

import argparse

from lcbayes.core.errors import InputError

SHELLS = ("bash", "zsh", "fish")
_BASH = """\
_lcbayes() {
  local word="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}" command="${COMP_WORDS[1]}"
  local words=""
  if [ "$COMP_CWORD" -eq 1 ]; then
    words="@COMMANDS@ --help --version"
  else
    case "$command $before" in
@VALUES@
      *) case "$command" in
@OPTIONS@
      esac ;;
    esac
  fi
  COMPREPLY=( $(compgen -W "$words" -- "$word") )
}
complete -o default -F _lcbayes lcbayes
"""  # noqa: E501 - a line of the shell


def script(shell: str, parser: argparse.ArgumentParser) -> str:
    """The program that a shell reads to complete ``lcbayes``.

    Raises
    ------
    InputError
        The shell is unknown.
    """
    if shell not in SHELLS:
        raise InputError(f"--completion is {shell!r}; available: {', '.join(SHELLS)}")
    commands = _commands(parser)
    if shell == "fish":
        return _fish(commands)
    head = "autoload -U +X bashcompinit && bashcompinit\n" if shell == "zsh" else ""
    values = [
        f'      "{name} {flag}") words="{" ".join(_values(action))}" ;;'
        for name, command in commands.items()
        for action in command._actions
        if _values(action)
        for flag in action.option_strings
    ]
    options = [
        f'        {name}) words="{" ".join(_flags(command))}" ;;'
        for name, command in commands.items()
    ]
    filled = _BASH.replace("@COMMANDS@", " ".join(commands))
    filled = filled.replace("@VALUES@", "\n".join(values) or "      :) ;;")
    return head + filled.replace("@OPTIONS@", "\n".join(options))


def _commands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    groups = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return dict(next(groups).choices)


def _flags(command: argparse.ArgumentParser) -> list[str]:
    return [flag for a in command._actions for flag in a.option_strings if flag.startswith("--")]


def _values(action: argparse.Action) -> list[str]:
    """The values of an option, which its placeholder lists as ``{a,b}``."""
    shown = str(action.metavar or "")
    return shown[1:-1].split(",") if shown.startswith("{") else []


def _fish(commands: dict[str, argparse.ArgumentParser]) -> str:
    lines = [f'complete -c lcbayes -n __fish_use_subcommand -f -a "{" ".join(commands)}"']
    for name, command in commands.items():
        for action in command._actions:
            for flag in action.option_strings:
                if not flag.startswith("--"):
                    continue
                help_text = (action.help or "").replace("%%", "%").replace("'", "")
                values = f' -x -a "{" ".join(_values(action))}"' if _values(action) else ""
                needs = " -r" if action.nargs != 0 and not values else ""
                lines.append(
                    f"complete -c lcbayes -n '__fish_seen_subcommand_from {name}' "
                    f"-l {flag[2:]}{values}{needs} -d '{help_text}'"
                )
    return "\n".join(lines) + "\n"
