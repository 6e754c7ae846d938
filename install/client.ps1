# Installs the measuring client on Windows into %LOCALAPPDATA%\frontrunner-client and says what is missing.
# From a clone:  powershell -ExecutionPolicy Bypass -File install\client.ps1
# Not tried: no Windows was at hand.
$ErrorActionPreference = "Stop"
$source = Split-Path -Parent $PSScriptRoot
$target = Join-Path $env:LOCALAPPDATA "frontrunner-client"

py -3 -c "import sys; sys.exit(sys.version_info < (3, 11))"
if ($LASTEXITCODE -ne 0) {
    Write-Error "Python 3.11 or newer is needed, with its launcher py: install it from python.org"
    exit 3
}
py -3 -m venv $target
& "$target\Scripts\python.exe" -m pip install --quiet --disable-pip-version-check $source
if ($LASTEXITCODE -ne 0) {
    Write-Error "pip could not install the client: the lines above say why"
    exit 3
}
Write-Output "Installed. To take part:"
Write-Output "  $target\Scripts\python.exe -m client_kit run --server https://ADDRESS"
& "$target\Scripts\python.exe" -m client_kit doctor
exit $LASTEXITCODE
