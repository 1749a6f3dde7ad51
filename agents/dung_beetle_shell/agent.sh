#!/usr/bin/env bash
# The dung beetle as a shell script: one JSON object a line on standard input, one command a line on standard output.
# bash counts modulo 2^64, which is what SplitMix64 needs; jq reads the messages and reckons in doubles.
set -euo pipefail
here=$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")

# Print the next 100 random numbers of a seed, times 2^53, as a JSON array: random_numbers SEED HOW_MANY_WENT_BEFORE
random_numbers() {
  local seed=$1 before=$2 i z numbers=()
  for ((i = before + 1; i <= before + 100; i++)); do
    z=$((seed + i * 0x9E3779B97F4A7C15))
    z=$(((z ^ ((z >> 30) & 0x3FFFFFFFF)) * 0xBF58476D1CE4E5B9)) # >> copies the sign; the mask takes it off again
    z=$(((z ^ ((z >> 27) & 0x1FFFFFFFFF)) * 0x94D049BB133111EB))
    z=$((z ^ ((z >> 31) & 0x1FFFFFFFF)))
    numbers+=($(((z >> 11) & 0x1FFFFFFFFFFFFF)))
  done
  local IFS=,
  echo "[${numbers[*]}]"
}

while IFS= read -r message; do
  # An observation that awaits no command has no name here, so that it is passed over.
  case $(jq -r 'select(.awaiting_command != false).message' <<<"$message") in
    Briefing)
      briefing=$message
      { read -r version; read -r seed; } <<<"$(jq -r '.contract_version, .seed' <<<"$briefing")"
      [[ $version == 1.* ]] || { echo "expected contract version 1, was $version" >&2; exit 1; }
      memory='{"last_ohm": null, "side": 0}'
      n_draws=0
      ;;
    Observation)
      draws=$(random_numbers "$seed" "$n_draws")
      decision=$(jq -c -f "$here/decide.jq" \
        --argjson briefing "$briefing" --argjson memory "$memory" --argjson draws "$draws" <<<"$message")
      { read -r command; read -r memory; read -r drawn; } <<<"$decision"
      n_draws=$((n_draws + drawn))
      echo "$command"
      ;;
    Ending) break ;;
  esac
done
