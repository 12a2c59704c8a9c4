#undef R
#undef real
