# bash completion for hordctl, hord-lab, hordd, hord-mqtt, hord-page and hord-safe: asks the program itself for its commands and options, so that it is never out of date.

_hordctl() {
    local current=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]} k command=()
    for ((k = 1; k < COMP_CWORD; ++k)); do
        [[ ${COMP_WORDS[k]} == -* ]] && break
        "${COMP_WORDS[0]}" "${command[@]}" "${COMP_WORDS[k]}" --help >/dev/null 2>&1 || break
        command+=("${COMP_WORDS[k]}")
    done
    local help words
    help=$("${COMP_WORDS[0]}" "${command[@]}" --help 2>/dev/null)
    if [[ $current == -* ]]; then
        words=$(grep -oE '(^|[ ,])--?[a-z][a-z0-9-]*' <<<"$help" | tr -d ' ,' | sort -u)
    elif [[ $before == --* ]]; then  # the values of an option that has a few
        words=$(sed -n "s/^  \(-[a-z],\)\{0,1\}$before [A-Z]*:{\([a-z0-9_,-]*\)}.*/\2/p" <<<"$help" | tr , ' ')
    else  # a command's own commands, or what it can be given first
        words=$(sed -n '/^Subcommands:/,$p' <<<"$help" | sed -n 's/^  \([a-z][a-z-]*\).*/\1/p')
        words+=" $(sed -n '/^Positionals:/,/^Options:/s/^  [a-z-]* [A-Z]*:{\([a-z0-9_,-]*\)}.*/\1/p' <<<"$help" | tr , ' ')"
    fi
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
    [[ ${#COMPREPLY[@]} -gt 0 || $current == -* ]] || mapfile -t COMPREPLY < <(compgen -f -- "$current")
}
complete -o filenames -F _hordctl hordctl hord-lab hordd hord-mqtt hord-page hord-safe
