# Installs the measuring client on Windows into %LOCALAPPDATA%\frontrunner-client and says what is missing.
# From a clone:  powershell -ExecutionPolicy Bypass -File install\client.ps1
# Not tried: no Windows was at hand.
$ErrorActionPreference = "Stop"
$source = Split-Path -Parent $PSScriptRoot
$target = Join-Path $env:LOCALAPPDATA "frontrunner-client"

# Write-Error would end the script here, with another exit code.
function Stop-With([string]$message) {
    [Console]::Error.WriteLine($message)
    exit 3
}

if (-not (Get-Command py -ErrorAction SilentlyContinue)) {
    Stop-With "Python's launcher py is missing: install Python 3.11 or newer from python.org"
}
py -3 -c "import sys; sys.exit(sys.version_info < (3, 11))"
if ($LASTEXITCODE -ne 0) { Stop-With "Python 3.11 or newer is needed: install it from python.org" }
py -3 -m venv "$target"
if ($LASTEXITCODE -ne 0) { Stop-With "no virtual environment could be made in ${target}: the lines above say why" }
$python = Join-Path $target "Scripts\python.exe"
& $python -m pip install --quiet --disable-pip-version-check "$source[opencl,wasm]"
if ($LASTEXITCODE -ne 0) {
    Write-Output "pip could not install OpenCL: the lines above say why. Installing WebAssembly alone."
    & $python -m pip install --quiet --disable-pip-version-check "$source[wasm]"
}
if ($LASTEXITCODE -ne 0) { Stop-With "pip could not install the client: the lines above say why" }
Write-Output "Installed. To take part:"
Write-Output "  & `"$python`" -m client_kit run --server https://ADDRESS"
& $python -m client_kit doctor
exit $LASTEXITCODE
