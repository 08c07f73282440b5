#!/usr/bin/env bash
# The Dockerfile without a daemon: its steps in a fresh environment, then what it is for.
#
#     bash scripts/try_container.sh FOLDER
#
# Commands run in namespaces of their own: as a user without home or name, on a read-only disk, without network, with a
# folder of temporary files alone. That takes root and unshare; elsewhere they run as they are, and it is said.
# PYTHON=... chooses the interpreter. Whatever fails ends it.
set -euo pipefail
cd "$(dirname "$0")/.."
mkdir -p "$1/tmp"
folder=$(realpath "$1")
tmp=$folder/tmp
chmod 755 "$folder"
"${PYTHON:-python3}" -m venv --clear "$folder/image"

mapfile -t pip < <(env | grep ^PIP_ || true)
known=("PATH=$folder/image/bin:/usr/bin:/bin") # what the image's commands see
entry=
while read -r -u 3 word rest; do
  there=${rest//\/opt\/dexgrasp/$folder/opt}
  case $word in
    ENV) known+=("$there") ;;
    RUN)
      case $rest in
        apt-get* | useradd*) ;; # of the system
        *) echo "+ $there" && env -i "${pip[@]}" "HOME=$folder" "${known[@]}" sh -c "$there" ;;
      esac
      ;;
    ENTRYPOINT | CMD) entry+=" $(tr -d '[],"' <<<"$rest")" ;;
  esac
done 3< <(sed -e ':joined' -e '/\\$/{N;s/\\\n/ /;b joined' -e '}' -e '/^#/d' Dockerfile)
known=("${known[@]/%=\/tmp/=$tmp}" "TMPDIR=$tmp")

locked() {
  mount --make-rprivate / || exit 77
  for place in / "$folder"; do
    mount --bind "$place" "$place" && mount -o remount,bind,ro "$place" || exit 77
  done
  mount -t tmpfs -o mode=1777 tmpfs "$tmp" || exit 77
  user="--reuid 10001 --regid 10001 --clear-groups"
  # A folder or Python closed to others: root without powers.
  setpriv $user env "$folder/image/bin/python" -c "" || user=--bounding-set=-all
  cd "$tmp" && exec setpriv $user env -i "${known[@]}" sh -c "$1"
}

try() {
  local status=0
  echo "+ $1"
  said=$(unshare -m -n bash -c "$(declare -p folder tmp known && declare -f locked); locked \"\$1\"" - "$1" 2>&1) ||
    status=$?
  if [ "$status" = 77 ] || [[ $said == *unshare:* ]]; then
    echo "no namespaces here: as it is"
    status=0
    said=$(cd "$tmp" && env -i "${known[@]}" sh -c "$1" 2>&1) || status=$?
  fi
  tail -c 1200 <<<"$said"
  [ "$status" = 0 ] || { echo "$1 ended with $status" && exit 1; }
}

try "${entry//\/tmp/$tmp}"
try "dexgrasp doctor"
[[ $said == *"beside the code"* ]] || { echo "code compiled in the image is not used" && exit 1; }
try "dexgrasp demo --no-pictures --out $tmp/demo"
try "dexgrasp plan soda --out $tmp/soda"
try "dexgrasp evaluate --agents hardcoded --objects sugar_box --trials 1 --out $tmp/run"
try "python -c \"import gymnasium as gym, dexgrasp_env
print(gym.make_vec('DexGrasp/Lift-v2', num_envs=4).reset(seed=0))\""
